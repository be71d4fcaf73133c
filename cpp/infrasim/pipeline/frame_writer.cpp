#include "infrasim/pipeline/frame_writer.h"

#include <new>
#include <system_error>
#include <utility>

namespace infrasim {

namespace {

/// Starts a thread. Returns an empty thread if the system can start no more threads.
template <class Work>
std::jthread start(const Work& work) {
  try {
    return std::jthread(work);
  } catch (const std::system_error&) {
    return {};
  } catch (const std::bad_alloc&) {
    return {};
  }
}

}  // namespace

FrameWriter::FrameWriter(std::size_t most) : most_(most), thread_(start([this] { work(); })) {}

FrameWriter::~FrameWriter() {
  const std::lock_guard lock(mutex_);
  closed_ = true;
  changed_.notify_all();
}

void FrameWriter::write(Job job) {
  {
    const std::lock_guard lock(mutex_);
    if (error_) std::rethrow_exception(error_);
    if (thread_.joinable() && waiting_.size() < most_) {
      waiting_.push_back(std::move(job));
      changed_.notify_all();
      return;
    }
  }
  job();
}

void FrameWriter::finish() {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [&] { return error_ || (waiting_.empty() && !busy_); });
  if (error_) std::rethrow_exception(error_);
}

void FrameWriter::work() {
  std::unique_lock lock(mutex_);
  while (true) {
    changed_.wait(lock, [&] { return closed_ || !waiting_.empty(); });
    if (waiting_.empty()) return;
    Job job = std::move(waiting_.front());
    waiting_.pop_front();
    busy_ = true;
    lock.unlock();
    std::exception_ptr error;
    try {
      job();
    } catch (...) {
      error = std::current_exception();
    }
    job = nullptr;  // frees the job's frame before the mutex is locked
    lock.lock();
    busy_ = false;
    if (error) {
      error_ = error;
      waiting_.clear();
    }
    changed_.notify_all();
    if (error_) return;
  }
}

}  // namespace infrasim
