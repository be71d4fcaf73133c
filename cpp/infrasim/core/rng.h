#pragma once

#include <cmath>
#include <cstdint>
#include <numbers>
#include <string_view>
#include <vector>

#include "infrasim/core/math.h"

namespace infrasim {

/// Applies the finaliser of SplitMix64 (Steele, Lea, Flood 2014): a bijection whose output bits all
/// depend on all input bits.
constexpr std::uint64_t mix64(std::uint64_t x) {
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9ULL;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebULL;
  return x ^ (x >> 31);
}

/// Returns the FNV-1a hash of a name.
constexpr std::uint64_t hash_name(std::string_view name) {
  std::uint64_t h = 0xcbf29ce484222325ULL;
  for (const char c : name) h = (h ^ static_cast<unsigned char>(c)) * 0x100000001b3ULL;
  return h;
}

/// Returns a hash of the bytes of the values.
template <class T>
std::uint64_t hash_all(const std::vector<T>& values) {
  return hash_name({reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T)});
}

/// Counter-based random numbers. A sample is a pure function of the key and of the sample's number
/// j. Results therefore do not depend on the order in which rays or frames are computed.
class Rng {
 public:
  constexpr explicit Rng(std::uint64_t key) : key_(key) {}

  /// Returns the random stream with a name, such as that of a LiDAR or of the traffic.
  static constexpr Rng of(std::uint64_t seed, std::string_view name) {
    return Rng(mix64(mix64(seed + kStep) ^ hash_name(name)));
  }

  /// Returns the random stream of a part of this stream, such as that of a vehicle, a frame, or a
  /// ray of a frame. Keys are mixed at each level. If keys were only added, ray i + 1 of a frame
  /// would have the samples of ray i in the next frame. If samples are also taken from this stream
  /// itself, the indices of its parts must begin at 1.
  constexpr Rng at(std::uint64_t index) const { return Rng(mix64(key_ + kStep * (index + 1))); }

  /// Returns sample j, uniform in [0, 1).
  constexpr double uniform(unsigned j) const {
    return static_cast<double>(bits(j) >> 11) * 0x1p-53;
  }

  /// Returns sample j, uniform in (0, 1), both ends excluded.
  constexpr double open_uniform(unsigned j) const {
    return (static_cast<double>(bits(j) >> 12) + 0.5) * 0x1p-52;
  }

  /// Returns sample j of the standard normal distribution (Box-Muller), made from the uniform
  /// samples j and j + 1.
  double normal(unsigned j) const {
    const double radius = std::sqrt(-2.0 * math::log(1.0 - uniform(j)));
    return radius * math::cos(2.0 * std::numbers::pi * uniform(j + 1));
  }

  constexpr std::uint64_t bits(unsigned j) const { return mix64(key_ + kStep * (j + 1ULL)); }

 private:
  static constexpr std::uint64_t kStep = 0x9e3779b97f4a7c15ULL;
  std::uint64_t key_;
};

}  // namespace infrasim
