#pragma once

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <exception>
#include <functional>
#include <map>
#include <mutex>
#include <new>
#include <optional>
#include <span>
#include <string>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

#include "infrasim/core/errors.h"
#include "infrasim/pipeline/simulate.h"

namespace infrasim {

inline constexpr int kMostThreads = 1024;

/// The frames to compute, and how many frames may be ahead of the consumer.
struct Schedule {
  std::vector<int> frames;
  int threads = 1;
  std::size_t ahead = 1;  ///< maximum number of started frames that are not yet fetched
  const std::atomic<int>* stop = nullptr;  ///< once the value is not 0, no frame is started
  bool cast_all =
      false;  ///< whether static surfaces are cast in every frame, without static layers
};

/// Computes frames on several threads and returns the results in frame order. One thread computes a
/// whole frame with its own simulator. If a thread can't be started, the other threads do its work.
/// If no thread can be started, `next` computes the frames.
template <class Result>
class Scheduler {
 public:
  /// Computes the result of one frame.
  using Work = std::function<Result(FrameSimulator&, int)>;
  /// Computes the result of one frame of several worlds, with one simulator per world.
  using WorkAtAll = std::function<Result(std::span<FrameSimulator>, int)>;

  /// The world must outlive the scheduler.
  /// @throws ConfigError if the number of threads is not 1 to kMostThreads
  Scheduler(const World& world, std::vector<LidarConfig> lidars, Schedule schedule, Work work)
      : Scheduler(std::span(&world, 1), std::move(lidars), std::move(schedule),
                  [work = std::move(work)](std::span<FrameSimulator> simulators, int k) {
                    return work(simulators.front(), k);
                  }) {}
  Scheduler(std::span<const World> worlds, std::vector<LidarConfig> lidars, Schedule schedule,
            WorkAtAll work)
      : worlds_(worlds),
        lidars_(std::move(lidars)),
        schedule_(std::move(schedule)),
        work_(std::move(work)),
        layers_(worlds.size()) {
    for (std::size_t i = 0; i < worlds.size() && !schedule_.cast_all; ++i)
      layers_[i] = make_static_layers(worlds[i], lidars_, schedule_.frames.size(),
                                      kMostLayerBytes / worlds.size());
    for (std::size_t i = 0; i < worlds.size(); ++i)
      filters_.push_back(FrameSimulator::learn_filters(worlds[i], lidars_, layers_[i]));
    const int threads = schedule_.threads;
    if (threads < 1 || threads > kMostThreads)
      throw ConfigError("threads: expected 1 to " + std::to_string(kMostThreads) + ", got " +
                        std::to_string(threads));
    start(std::min(static_cast<std::size_t>(threads), schedule_.frames.size()));
  }
  /// Waits for the frames that are being computed, and discards results that the caller has not
  /// fetched.
  ~Scheduler() {
    const std::lock_guard lock(mutex_);
    closed_ = true;
    changed_.notify_all();
  }
  Scheduler(const Scheduler&) = delete;
  Scheduler& operator=(const Scheduler&) = delete;

  /// Returns the next frame's number and result. Returns no value after the last frame, or after
  /// the last frame that was started before a stop. The function waits until the result is ready.
  /// @throws the exception of the first failed frame, when that frame is the next one; no frame is
  ///   started after an error
  std::optional<std::pair<int, Result>> next() {
    if (threads_.empty()) compute_here();
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return ready_.contains(taken_) || working_ == 0; });
    auto result = ready_.extract(taken_);
    if (result.empty() && error_) std::rethrow_exception(error_);
    if (result.empty()) return std::nullopt;
    changed_.notify_all();
    return std::pair{schedule_.frames[taken_++], std::move(result.mapped())};
  }

  /// Returns the number of threads that compute frames.
  int threads() const { return std::max(1, static_cast<int>(threads_.size())); }

 private:
  void start(std::size_t threads) {
    const std::lock_guard lock(mutex_);  // no thread may end before all threads are counted
    threads_.reserve(threads);
    while (threads_.size() < threads && start_one()) continue;
    working_ = threads_.size();
  }

  /// Starts a thread. Returns false if the system can start no more threads.
  bool start_one() {
    try {
      threads_.emplace_back([this] { compute_all(); });
      return true;
    } catch (const std::system_error&) {
      return false;
    } catch (const std::bad_alloc&) {
      return false;
    }
  }

  void compute_all() {
    try {
      std::vector<FrameSimulator> simulators = make_simulators();
      while (const auto index = claim()) compute(simulators, *index);
    } catch (...) {
      fail(0);
    }
    const std::lock_guard lock(mutex_);
    --working_;
    changed_.notify_all();
  }

  void compute_here() {
    if (caller_simulators_.empty()) caller_simulators_ = make_simulators();
    if (const auto index = claim()) compute(caller_simulators_, *index);
  }

  std::vector<FrameSimulator> make_simulators() const {
    std::vector<FrameSimulator> simulators;
    for (std::size_t i = 0; i < worlds_.size(); ++i)
      simulators.emplace_back(worlds_[i], lidars_, layers_[i], filters_[i]);
    return simulators;
  }

  void compute(std::span<FrameSimulator> simulators, std::size_t index) {
    try {
      Result result = work_(simulators, schedule_.frames[index]);
      const std::lock_guard lock(mutex_);
      ready_.emplace(index, std::move(result));
      changed_.notify_all();
    } catch (...) {
      fail(index);
    }
  }

  /// Returns the index of the next frame to compute; no value if there is none or after a stop.
  /// Waits while `Schedule::ahead` frames are started but not yet fetched.
  std::optional<std::size_t> claim() {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return closed_ || started_ < taken_ + schedule_.ahead; });
    const bool stopped = schedule_.stop != nullptr && *schedule_.stop != 0;
    if (closed_ || stopped || started_ == schedule_.frames.size()) return std::nullopt;
    return started_++;
  }

  /// Stores the current error, unless an error of an earlier frame is already stored.
  void fail(std::size_t index) {
    const std::lock_guard lock(mutex_);
    if (!error_ || index < failed_) {
      error_ = std::current_exception();
      failed_ = index;
    }
    closed_ = true;
    changed_.notify_all();
  }

  const std::span<const World> worlds_;
  const std::vector<LidarConfig> lidars_;
  const Schedule schedule_;
  const WorkAtAll work_;
  std::vector<StaticLayers> layers_;   ///< static layers of each world
  std::vector<LidarFilters> filters_;  ///< filters of each world

  std::mutex mutex_;
  std::condition_variable changed_;
  std::size_t started_ = 0;  ///< index of the next frame to start, in the schedule
  std::size_t taken_ = 0;
  std::size_t failed_ = 0;
  std::size_t working_ = 0;  ///< number of threads that have not ended
  bool closed_ = false;
  std::exception_ptr error_;
  std::map<std::size_t, Result> ready_;
  std::vector<FrameSimulator> caller_simulators_;  ///< used by the caller if no thread could start
  std::vector<std::jthread> threads_;              // last member: joined before other members end
};

}  // namespace infrasim
