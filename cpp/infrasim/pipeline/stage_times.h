#pragma once

#include <array>
#include <cstddef>
#include <ctime>
#include <string_view>

namespace infrasim {

/// Processing stages of the rays of a frame, in the order of execution.
enum class Stage { kMaking, kCasting, kLeaves, kPanes, kBeam, kReturns, kCollecting };

inline constexpr std::array<std::string_view, 7> kStageNames{
    "making rays", "casting", "leaves", "panes", "beam", "return model", "collecting"};

/// CPU time of each stage. CPU time depends less on other processes than wall time.
class StageTimes {
 public:
  /// Runs a stage and adds its CPU time to `times`. If `times` is null, nothing is measured.
  template <class Work>
  static auto measure(StageTimes* times, Stage stage, const Work& work) {
    const Timer timer(times, stage);
    return work();
  }

  /// Returns the total CPU time of each stage, in seconds.
  const std::array<double, kStageNames.size()>& seconds() const { return seconds_; }

 private:
  class Timer {
   public:
    Timer(StageTimes* times, Stage stage)
        : times_(times), stage_(stage), start_s_(times != nullptr ? thread_cpu_s() : 0) {}
    ~Timer() {
      if (times_ != nullptr)
        times_->seconds_[static_cast<std::size_t>(stage_)] += thread_cpu_s() - start_s_;
    }
    Timer(const Timer&) = delete;
    Timer& operator=(const Timer&) = delete;

   private:
    StageTimes* times_;
    Stage stage_;
    double start_s_;
  };

  static double thread_cpu_s() {
    timespec now{};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
  }

  std::array<double, kStageNames.size()> seconds_{};
};

}  // namespace infrasim
