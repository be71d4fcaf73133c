#include "infrasim/pipeline/frame_writer.h"

#include <gtest/gtest.h>

#include <atomic>
#include <condition_variable>
#include <mutex>
#include <new>
#include <optional>
#include <stdexcept>
#include <thread>
#include <vector>

#include "allocations.h"

namespace infrasim {
namespace {

using testing::allocations_left;

/// A job that waits until the test releases it.
class Gate {
 public:
  void open() {
    const std::lock_guard lock(mutex_);
    open_ = true;
    changed_.notify_all();
  }
  void pass() {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return open_; });
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  bool open_ = false;
};

TEST(frame_writer, has_done_every_job_when_it_is_finished) {
  for (const std::size_t most : {0, 1, 3, 100}) {
    FrameWriter writer(most);
    std::atomic<int> sum = 0;
    {
      std::vector<std::jthread> threads;
      for (int t = 0; t < 4; ++t)
        threads.emplace_back([&] {
          for (int i = 1; i <= 100; ++i) writer.write([&sum, i] { sum += i; });
        });
    }
    writer.finish();
    EXPECT_EQ(sum, 4 * 5050);
  }
}

TEST(frame_writer, does_what_waits_before_it_goes) {
  std::atomic<int> done = 0;
  {
    FrameWriter writer(50);
    for (int i = 0; i < 50; ++i) writer.write([&] { ++done; });
  }
  EXPECT_EQ(done, 50);
}

TEST(frame_writer, lets_no_more_jobs_wait_than_it_may) {
  Gate gate;
  FrameWriter writer(2);
  const auto caller = std::this_thread::get_id();
  std::atomic<int> here = 0, there = 0;
  writer.write([&] { gate.pass(); });
  for (int i = 0; i < 10; ++i)
    writer.write([&] { (std::this_thread::get_id() == caller ? here : there) += 1; });
  // `here` counts the jobs that the caller ran itself; the other jobs wait in the queue
  EXPECT_GE(here, 7);
  EXPECT_EQ(there, 0);
  gate.open();
  writer.finish();
  EXPECT_EQ(here + there, 10);
}

TEST(frame_writer, without_memory_for_a_thread_has_its_jobs_done_by_the_caller) {
  bool some = false, all = false;
  for (int allocations = 0; !all; ++allocations) {
    std::optional<FrameWriter> writer;
    allocations_left = allocations;
    try {
      writer.emplace(3U);
    } catch (const std::bad_alloc&) {
      allocations_left = -1;
      continue;
    }
    all = allocations_left > 0;
    allocations_left = -1;
    bool by_caller = false;
    writer->write([&, caller = std::this_thread::get_id()] {
      by_caller = std::this_thread::get_id() == caller;
    });
    writer->finish();
    some = some || by_caller;
  }
  EXPECT_TRUE(some);
}

TEST(frame_writer, throws_what_a_job_threw_at_the_next_one_and_at_the_end) {
  FrameWriter writer(5);
  std::atomic<int> after = 0;
  writer.write([] { throw std::runtime_error("full disk"); });
  EXPECT_THROW(writer.finish(), std::runtime_error);
  EXPECT_THROW(writer.write([&] { ++after; }), std::runtime_error);
  EXPECT_THROW(writer.finish(), std::runtime_error);
  EXPECT_EQ(after, 0);
}

TEST(frame_writer, throws_what_a_job_of_the_caller_throws) {
  FrameWriter writer(0);
  EXPECT_THROW(writer.write([] { throw std::runtime_error("full disk"); }), std::runtime_error);
}

}  // namespace
}  // namespace infrasim
