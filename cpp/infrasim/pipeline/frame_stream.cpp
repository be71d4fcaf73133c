#include "infrasim/pipeline/frame_stream.h"

#include <condition_variable>
#include <exception>
#include <map>
#include <mutex>
#include <string>
#include <system_error>
#include <thread>

#include "infrasim/core/errors.h"

namespace infrasim {

struct FrameStream::Impl {
  const World& world;
  std::vector<LidarConfig> lidars;
  std::vector<int> numbers;
  std::size_t ahead;

  std::mutex mutex;
  std::condition_variable changed;
  std::size_t started = 0;
  std::size_t taken = 0;
  bool stopped = false;
  std::exception_ptr error;
  std::map<std::size_t, std::vector<Frame>> ready;
  std::vector<std::jthread> threads;  // last: joined before the rest goes

  Impl(const World& w, std::vector<LidarConfig> l, std::vector<int> n, int thread_count)
      : world(w),
        lidars(std::move(l)),
        numbers(std::move(n)),
        ahead(2 * static_cast<std::size_t>(thread_count)) {
    if (thread_count < 1 || thread_count > kMostThreads)
      throw ConfigError("threads: found " + std::to_string(thread_count) + ", allowed 1 to " +
                        std::to_string(kMostThreads));
    for (int i = 0; i < thread_count; ++i) start();
  }

  /// Without one more thread those that run do the work.
  void start() {
    try {
      threads.emplace_back([this] { work(); });
    } catch (const std::system_error&) {
      if (threads.empty()) throw;
    }
  }

  /// Index of the next frame to compute; waits while enough of them lie ready.
  std::optional<std::size_t> claim() {
    std::unique_lock lock(mutex);
    changed.wait(lock, [&] { return stopped || started < taken + ahead; });
    if (stopped || started == numbers.size()) return std::nullopt;
    return started++;
  }

  void work() {
    try {
      FrameSimulator simulator(world, lidars);
      const std::vector<bool> wanted(lidars.size(), true);
      while (const auto i = claim()) {
        std::vector<Frame> frames = simulator.simulate(numbers[*i], wanted);
        const std::lock_guard lock(mutex);
        ready[*i] = std::move(frames);
        changed.notify_all();
      }
    } catch (...) {
      const std::lock_guard lock(mutex);
      error = std::current_exception();
      changed.notify_all();
    }
  }
};

FrameStream::FrameStream(const World& world, std::vector<LidarConfig> lidars,
                         std::vector<int> frames, int threads)
    : impl_(std::make_unique<Impl>(world, std::move(lidars), std::move(frames), threads)) {}

FrameStream::~FrameStream() {
  const std::lock_guard lock(impl_->mutex);
  impl_->stopped = true;
  impl_->changed.notify_all();
}

std::optional<std::pair<int, std::vector<Frame>>> FrameStream::next() {
  Impl& m = *impl_;
  std::unique_lock lock(m.mutex);
  if (m.taken == m.numbers.size()) return std::nullopt;
  m.changed.wait(lock, [&] { return m.error || m.ready.contains(m.taken); });
  if (m.error) std::rethrow_exception(m.error);
  auto node = m.ready.extract(m.taken);
  const int number = m.numbers[m.taken++];
  m.changed.notify_all();
  return std::pair{number, std::move(node.mapped())};
}

}  // namespace infrasim
