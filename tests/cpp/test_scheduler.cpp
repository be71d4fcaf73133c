#include "infrasim/pipeline/scheduler.h"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <fstream>
#include <new>
#include <optional>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "allocations.h"
#include "small_scenes.h"

namespace infrasim {
namespace {

using testing::allocations_left;
using testing::empty_road;

using Numbers = Scheduler<int>;

const World& world() {
  static const World kWorld = build_world(empty_road());
  return kWorld;
}

std::vector<int> first_frames(int n) {
  std::vector<int> frames;
  for (int k = 0; k < n; ++k) frames.push_back(k);
  return frames;
}

/// Returns a result that depends on the frame. Even frames take longer, so that results are not
/// ready in frame order.
int slowly(FrameSimulator&, int k) {
  std::this_thread::sleep_for(std::chrono::milliseconds(k % 2 == 0 ? 3 : 0));
  return 10 * k;
}

TEST(scheduler, hands_results_over_in_the_order_of_the_frames) {
  for (const int threads : {1, 4, 100}) {
    const std::vector<int> frames{7, 3, 4, 0, 2, 9, 8, 6};
    Numbers scheduler(world(), {}, {.frames = frames, .threads = threads, .ahead = 3}, slowly);
    for (const int k : frames) EXPECT_EQ(scheduler.next(), std::pair(k, 10 * k));
    EXPECT_EQ(scheduler.next(), std::nullopt);
    EXPECT_EQ(scheduler.next(), std::nullopt);
  }
}

TEST(scheduler, of_no_frames_has_no_results) {
  Numbers scheduler(world(), {}, {.frames = {}, .threads = 2}, slowly);
  EXPECT_EQ(scheduler.next(), std::nullopt);
}

TEST(scheduler, starts_no_more_threads_than_frames) {
  const Numbers scheduler(world(), {}, {.frames = {1, 2}, .threads = 8, .ahead = 8}, slowly);
  EXPECT_EQ(scheduler.threads(), 2);
}

/// While this object exists, the process can't allocate the stack of another thread.
class NoRoomForStacks {
 public:
  NoRoomForStacks() {
    rlim_t pages = 0;
    std::ifstream("/proc/self/statm") >> pages;
    getrlimit(RLIMIT_AS, &before_);
    rlimit tight = before_;
    tight.rlim_cur = pages * static_cast<rlim_t>(sysconf(_SC_PAGESIZE)) + (1U << 21);
    setrlimit(RLIMIT_AS, &tight);
  }
  ~NoRoomForStacks() { setrlimit(RLIMIT_AS, &before_); }
  NoRoomForStacks(const NoRoomForStacks&) = delete;
  NoRoomForStacks& operator=(const NoRoomForStacks&) = delete;

 private:
  rlimit before_{};
};

TEST(scheduler, does_without_threads_that_can_not_be_started) {
#ifdef __SANITIZE_ADDRESS__
  GTEST_SKIP() << "the sanitizer needs the memory";
#endif
  constexpr int kThreads = 32;  // more threads than the number of stacks that the C library keeps
  const std::vector<int> frames = first_frames(kThreads);
  world();
  std::optional<Numbers> scheduler;
  {
    const NoRoomForStacks tight;
    scheduler.emplace(world(), std::vector<LidarConfig>{},
                      Schedule{.frames = frames, .threads = kThreads, .ahead = 4}, slowly);
  }
  EXPECT_LT(scheduler->threads(), kThreads);
  for (const int k : frames) EXPECT_EQ(scheduler->next(), std::pair(k, 10 * k));
  EXPECT_EQ(scheduler->next(), std::nullopt);
}

TEST(scheduler, that_runs_out_of_memory_anywhere_as_it_starts_gives_up_or_works) {
  constexpr int kThreads = 6;
  const std::vector<int> frames = first_frames(12);
  world();
  int given_up = 0, with_fewer = 0, whole = 0;
  for (int allocations = 0; whole == 0; ++allocations) {
    std::optional<Numbers> scheduler;
    const Numbers::Work work = slowly;
    bool started = true;
    allocations_left = allocations;
    try {
      scheduler.emplace(world(), std::vector<LidarConfig>{},
                        Schedule{.frames = frames, .threads = kThreads, .ahead = 2}, work);
    } catch (const std::bad_alloc&) {
      started = false;
    }
    const bool ran_out = allocations_left == 0;
    allocations_left = -1;
    if (!started) {
      ++given_up;
      continue;
    }
    for (const int k : frames) EXPECT_EQ(scheduler->next(), std::pair(k, 10 * k));
    EXPECT_EQ(scheduler->next(), std::nullopt);
    (scheduler->threads() < kThreads ? with_fewer : whole) += 1;
    EXPECT_TRUE(ran_out || whole == 1);
  }
  EXPECT_GT(given_up, 3);
  EXPECT_GE(with_fewer, kThreads);
}

TEST(scheduler, computes_no_further_ahead_than_asked) {
  std::atomic<int> started = 0;
  Numbers scheduler(world(), {}, {.frames = first_frames(50), .threads = 4, .ahead = 5},
                    [&](FrameSimulator&, int k) { return ++started, k; });
  for (int k = 0; k < 50; ++k) {
    EXPECT_LE(started, k + 5);
    EXPECT_EQ(scheduler.next(), std::pair(k, k));
  }
}

TEST(scheduler, throws_the_first_frames_error_after_the_frames_before_it) {
  const auto work = [](FrameSimulator& simulator, int k) {
    slowly(simulator, k);
    if (k >= 4) throw std::runtime_error("frame " + std::to_string(k));
    return k;
  };
  Numbers scheduler(world(), {}, {.frames = first_frames(20), .threads = 3, .ahead = 20}, work);
  for (int k = 0; k < 4; ++k) EXPECT_EQ(scheduler.next(), std::pair(k, k));
  for (int again = 0; again < 2; ++again) try {
      scheduler.next();
      ADD_FAILURE() << "no error";
    } catch (const std::runtime_error& error) {
      EXPECT_STREQ(error.what(), "frame 4");
    }
}

TEST(scheduler, starts_no_frame_after_an_error) {
  std::atomic<int> started = 0;
  const auto work = [&](FrameSimulator&, int k) {
    ++started;
    if (k == 0) throw std::runtime_error("frame 0");
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    return k;
  };
  {
    Numbers scheduler(world(), {}, {.frames = first_frames(100), .threads = 2, .ahead = 100}, work);
    EXPECT_THROW(scheduler.next(), std::runtime_error);
  }
  EXPECT_LE(started, 10);
}

TEST(scheduler, gives_all_frames_that_were_started_before_a_stop_and_no_other) {
  std::atomic<int> stop = 0;
  std::atomic<int> started = 0;
  const auto work = [&](FrameSimulator&, int k) {
    ++started;
    if (k == 5) stop = 15;
    return k;
  };
  Numbers scheduler(world(), {},
                    {.frames = first_frames(100), .threads = 3, .ahead = 100, .stop = &stop}, work);
  int done = 0;
  while (const auto frame = scheduler.next()) EXPECT_EQ(frame->first, done++);
  EXPECT_EQ(done, started);
  EXPECT_GE(done, 6);
  EXPECT_LT(done, 100);
}

TEST(scheduler, gone_with_frames_under_way_waits_for_them) {
  std::atomic<int> under_way = 0;
  {
    const Numbers scheduler(world(), {}, {.frames = first_frames(9), .threads = 3, .ahead = 9},
                            [&](FrameSimulator& simulator, int k) {
                              ++under_way;
                              slowly(simulator, 0);
                              return --under_way, k;
                            });
  }
  EXPECT_EQ(under_way, 0);
}

TEST(scheduler, of_threads_that_can_not_be_is_an_error) {
  for (const int threads : {-1, 0, kMostThreads + 1})
    EXPECT_THROW(Numbers(world(), {}, {.frames = {0}, .threads = threads}, slowly), ConfigError);
}

}  // namespace
}  // namespace infrasim
