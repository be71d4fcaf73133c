#pragma once

#include <condition_variable>
#include <cstddef>
#include <deque>
#include <exception>
#include <functional>
#include <mutex>
#include <thread>

namespace infrasim {

/// Runs jobs one after the other on a separate thread, while other threads compute. If the short
/// queue of jobs is full, the caller runs the job. If the thread could not start, the callers run
/// all jobs.
class FrameWriter {
 public:
  using Job = std::function<void()>;

  /// @param most maximum number of waiting jobs
  explicit FrameWriter(std::size_t most);
  /// Runs the waiting jobs, unless a job has failed.
  ~FrameWriter();
  FrameWriter(const FrameWriter&) = delete;
  FrameWriter& operator=(const FrameWriter&) = delete;

  /// Adds a job. Any thread may call this function. The job is done before `finish` returns.
  /// @throws the exception of an earlier job or of this job
  void write(Job job);

  /// Waits until all jobs are done.
  /// @throws the exception of the first job that failed
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
  std::jthread thread_;  // last member, so that it is joined before other members are destroyed
};

}  // namespace infrasim
