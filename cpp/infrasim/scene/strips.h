#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "infrasim/scene/curve.h"
#include "infrasim/scene/outline_index.h"

namespace infrasim {

inline constexpr double kStripLength_m = 2;  ///< most that a strip is long

/// A piece of a road, lane or slope between two stations of its line.
struct Strip {
  std::array<Vec2, 4> outline;  ///< counter-clockwise
  double from = 0;
  double to = 0;
  std::size_t of = 0;  ///< road or lane

  Vec2 middle() const { return 0.5 * (outline[0] + outline[2]); }
};

/// "x 12.3, y -4", for messages.
std::string at_text(Vec2 point);

/// The surface between two lines beside a curve; `longer` metres are added at both of its ends.
std::vector<Strip> cut_into_strips(const Curve& curve, double left_m, double right_m,
                                   std::size_t of, double longer = 0);

/// Strips, found by place.
class StripIndex {
 public:
  void add(const std::vector<Strip>& strips);

  /// The first strip that an outline meets, and that is `wanted`; null if there is none.
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
