#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "infrasim/scene/curve.h"
#include "infrasim/scene/outline_index.h"

namespace infrasim {

inline constexpr double kStripLength_m = 2;  ///< maximum length of a strip along its line

/// A piece of a road, lane or slope between two stations of its line.
struct Strip {
  std::array<Vec2, 4> outline;  ///< corners, counter-clockwise
  double from = 0;
  double to = 0;
  std::size_t of = 0;  ///< index of the strip's road or lane

  Vec2 middle() const { return 0.5 * (outline[0] + outline[2]); }
};

/// Formats a position for messages, such as "x 12.3, y -4".
std::string at_text(Vec2 point);

/// Cuts the surface between two lines beside a curve into strips; `longer` metres are added at both
/// ends.
std::vector<Strip> cut_into_strips(const Curve& curve, double left_m, double right_m,
                                   std::size_t of, double longer = 0);

/// Finds strips by their position.
class StripIndex {
 public:
  void add(const std::vector<Strip>& strips);

  /// Returns the first strip that overlaps with an outline and for which `wanted` is true; null if
  /// there is none.
  template <class Wanted>
  const Strip* first_met(std::span<const Vec2> outline, const Wanted& wanted) const {
    const Strip* met = nullptr;
    index_.any_near(outline, [&](std::size_t i) {
      if (!wanted(strips_[i]) || !footprints_overlap(outline, strips_[i].outline)) return false;
      met = &strips_[i];
      return true;
    });
    return met;
  }

 private:
  std::vector<Strip> strips_;
  OutlineIndex index_;
};

}  // namespace infrasim
