#pragma once

#include <condition_variable>
#include <cstddef>
#include <deque>
#include <exception>
#include <functional>
#include <mutex>
#include <thread>

namespace infrasim {

/// Does jobs on a thread of its own, one after the other, while those that compute go on. Jobs that
/// wait are few: whoever brings another does it himself. Without a thread, so does everybody.
class FrameWriter {
 public:
  using Job = std::function<void()>;

  /// @param most jobs that wait
  explicit FrameWriter(std::size_t most);
  /// Does what waits, unless a job has failed.
  ~FrameWriter();
  FrameWriter(const FrameWriter&) = delete;
  FrameWriter& operator=(const FrameWriter&) = delete;

  /// For any thread. The job is done before `finish` returns.
  /// @throws what an earlier job threw, or this one
  void write(Job job);

  /// Waits until all jobs are done.
  /// @throws what the first job that failed threw
  void finish();

 private:
  void work();

  const std::size_t most_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Job> waiting_;
  bool busy_ = false;
  bool closed_ = false;
  std::exception_ptr error_;
  std::jthread thread_;  // last: joined before the rest goes
};

}  // namespace infrasim
