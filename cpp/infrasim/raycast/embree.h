#pragma once

#include <array>
#include <atomic>
#include <cstring>
#include <stdexcept>
#include <string>

// This header hides the differences between Embree 3 (Debian 12) and Embree 4 (Debian 13). If both
// are installed, Embree 4 is used, as in CMakeLists.txt.

#if __has_include(<embree4/rtcore.h>)
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

namespace infrasim {

/// Stores the first error of a device. Embree is a C library, so no exception may pass through its
/// functions. Any thread may cause an error, and any thread may check for one.
class EmbreeError {
 public:
  /// Registers this object with a device. The object must outlive the device.
  void watch(RTCDevice device) { rtcSetDeviceErrorFunction(device, keep, this); }

  /// @throws std::runtime_error if the device has reported an error
  void check() const {
    if (const RTCError code = code_.load(std::memory_order_acquire); code != RTC_ERROR_NONE)
      throw std::runtime_error("Embree error " + std::to_string(code) + ": " + text_.data());
  }

 private:
  static void keep(void* self, RTCError code, const char* text) noexcept {
    auto& error = *static_cast<EmbreeError*>(self);
    if (error.taken_.exchange(true)) return;
    if (text != nullptr) std::strncpy(error.text_.data(), text, error.text_.size() - 1);
    error.code_.store(code, std::memory_order_release);
  }

  std::atomic<bool> taken_ = false;  ///< whether an error has been stored, or is being stored
  std::atomic<RTCError> code_ = RTC_ERROR_NONE;
  std::array<char, 200> text_{};
};

/// Finds the nearest hits of 16 rays with nearby origins. Rays whose `valid` is 0 are not changed.
inline void intersect16(const int* valid, RTCScene scene, RTCRayHit16& rays) {
#if RTC_VERSION_MAJOR >= 4
  RTCIntersectArguments arguments;
  rtcInitIntersectArguments(&arguments);
  arguments.flags = RTC_RAY_QUERY_FLAG_COHERENT;
  rtcIntersect16(valid, scene, &rays, &arguments);
#else
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  rtcIntersect16(valid, scene, &context, &rays);
#endif
}

}  // namespace infrasim
