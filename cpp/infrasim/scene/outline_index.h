#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <span>
#include <unordered_map>
#include <vector>

#include "infrasim/core/geometry.h"

namespace infrasim {

/// Finds which of many small outlines may overlap with a given outline. Each outline is listed in
/// every square of a grid that its bounding box touches.
class OutlineIndex {
 public:
  void add(std::span<const Vec2> outline, std::size_t number) {
    for_each_square(outline, [&](std::uint64_t key) {
      squares_[key].push_back(number);
      return false;
    });
  }

  /// Returns true if `meets(number)` is true for a listed outline in a square that `outline`
  /// touches. An outline in several squares may be tested several times.
  template <class Meets>
  bool any_near(std::span<const Vec2> outline, const Meets& meets) const {
    return for_each_square(outline, [&](std::uint64_t key) {
      const auto square_entry = squares_.find(key);
      return square_entry != squares_.end() && std::ranges::any_of(square_entry->second, meets);
    });
  }

 private:
  static constexpr double kSquare = 8;  // m, side of a square of the grid

  /// Calls `stop(key)` for each square that the outline's bounding box touches. Returns true as
  /// soon as `stop` returns true.
  template <class Stop>
  static bool for_each_square(std::span<const Vec2> outline, const Stop& stop) {
    const auto [left, right] = std::ranges::minmax(outline, {}, &Vec2::x);
    const auto [down, up] = std::ranges::minmax(outline, {}, &Vec2::y);
    for (std::int64_t i = square(left.x); i <= square(right.x); ++i)
      for (std::int64_t j = square(down.y); j <= square(up.y); ++j)
        if (stop(static_cast<std::uint64_t>(i) << 32 ^ static_cast<std::uint32_t>(j))) return true;
    return false;
  }
  static std::int64_t square(double metres) {
    return static_cast<std::int64_t>(std::floor(metres / kSquare));
  }

  std::unordered_map<std::uint64_t, std::vector<std::size_t>> squares_;
};

}  // namespace infrasim
