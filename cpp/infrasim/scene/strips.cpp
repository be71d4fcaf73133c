#include "infrasim/scene/strips.h"

#include <algorithm>
#include <cmath>

#include "infrasim/config/fields.h"

namespace infrasim {

std::string at_text(Vec2 point) {
  const auto rounded = [](double m) { return config::number_text(std::round(m * 10) / 10); };
  return "x " + rounded(point.x) + ", y " + rounded(point.y);
}

std::vector<Strip> cut_into_strips(const Curve& curve, double left_m, double right_m,
                                   std::size_t of, double longer) {
  std::vector<Strip> out;
  const double length = curve.length();
  const auto side = [&](double s, double offset, double beyond) {
    const CurvePoint p = curve.at(s);
    return p.position + offset * heading_vector(p.heading + kPi / 2) +
           beyond * heading_vector(p.heading);
  };
  const auto n = static_cast<int>(std::max(1.0, std::ceil(length / kStripLength_m)));
  for (int i = 0; i < n; ++i) {
    const double from = length * i / n, to = length * (i + 1) / n;
    const double before = i == 0 ? -longer : 0, after = i + 1 == n ? longer : 0;
    out.push_back({{side(from, right_m, before), side(to, right_m, after), side(to, left_m, after),
                    side(from, left_m, before)},
                   from,
                   to,
                   of});
  }
  return out;
}

void StripIndex::add(const std::vector<Strip>& strips) {
  for (const Strip& strip : strips) {
    index_.add(strip.outline, strips_.size());
    strips_.push_back(strip);
  }
}

}  // namespace infrasim
