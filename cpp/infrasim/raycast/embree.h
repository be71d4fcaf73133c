#pragma once

#include <array>
#include <cstring>
#include <stdexcept>
#include <string>

// The differences between Embree 3 (Debian 12) and Embree 4 (Debian 13). If both are installed,
// Embree 4 is used, as in CMake.

#if __has_include(<embree4/rtcore.h>)
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

namespace infrasim {

/// Stores the first error of a device until `check` is called. Embree is a C library, so no
/// exception may pass through its functions.
class EmbreeError {
 public:
  /// Registers this object with a device. The object must outlive the device.
  void watch(RTCDevice device) { rtcSetDeviceErrorFunction(device, keep, this); }

  /// @throws std::runtime_error if there was one
  void check() const {
    if (code_ != RTC_ERROR_NONE)
      throw std::runtime_error("Embree error " + std::to_string(code_) + ": " + text_.data());
  }

 private:
  static void keep(void* self, RTCError code, const char* text) noexcept {
    auto& error = *static_cast<EmbreeError*>(self);
    if (error.code_ != RTC_ERROR_NONE) return;
    error.code_ = code;
    if (text != nullptr) std::strncpy(error.text_.data(), text, error.text_.size() - 1);
  }

  RTCError code_ = RTC_ERROR_NONE;
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
