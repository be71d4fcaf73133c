#include "infrasim/scene/lane_part.h"

#include <algorithm>
#include <cmath>

#include "infrasim/core/math.h"

namespace infrasim {

namespace {

constexpr double kLeastPart = 0.1;    // m, minimum length of a lane's part
constexpr double kLeastApart = 0.05;  // m, minimum distance between two rows of a part
// m; a heading is computed from the points this far before and after a station
constexpr double kHalfChord = 0.5;

struct Stretch {
  double from, to;  // start and end, m along a lane
};

/// Returns the stretches of a line within a circle, in order.
std::vector<Stretch> stretches_within(const Curve& line, Vec2 centre, double radius) {
  std::vector<Stretch> out;
  double s = 0;
  for (std::size_t i = 0; i + 1 < line.samples().size(); ++i) {
    const Vec2 from = line.samples()[i].position - centre;
    const Vec2 edge = line.samples()[i + 1].position - line.samples()[i].position;
    // Solves |from + u * edge| = radius for u.
    const double a = dot(edge, edge), half_b = dot(from, edge);
    const double root = half_b * half_b - a * (dot(from, from) - radius * radius);
    const double length = norm(edge), reach = root > 0 ? std::sqrt(root) : 0;
    const double enter = s + length * std::clamp((-half_b - reach) / a, 0.0, 1.0);
    const double leave = s + length * std::clamp((-half_b + reach) / a, 0.0, 1.0);
    s += length;
    if (leave <= enter) continue;
    if (!out.empty() && enter <= out.back().to)
      out.back().to = leave;
    else
      out.push_back({enter, leave});
  }
  std::erase_if(out, [](const Stretch& part) { return part.to - part.from < kLeastPart; });
  return out;
}

/// Returns the direction of travel at a station, from the points half a metre before and after it.
double heading_at(const Curve& line, double s) {
  const Vec2 before = line.at(s - kHalfChord).position, after = line.at(s + kHalfChord).position;
  const Vec2 way =
      norm(after - before) > kLeastPart / 2 ? after - before : after - line.at(s).position;
  return math::atan2(way.y, way.x);
}

/// Rounds a length as in roads.csv, so that programs that read the file get the same region. The
/// sum with 0.0 turns -0 into 0.
double as_written(double metres) { return std::round(metres * 1e4) / 1e4 + 0.0; }

LaneRow row_at(const LanePath& lane, double zero, double s) {
  const double at = zero + s;
  const Vec2 place = lane.line.at(at).position;
  return {as_written(s),
          {as_written(place.x), as_written(place.y)},
          as_written(lane.at(lane.z, at)),
          heading_at(lane.line, at),
          as_written(lane.at(lane.width_m, at) / 2)};
}

LanePart part_of(const LanePath& lane, const Stretch& stretch, Vec2 foot) {
  const double zero = stretch.from + lane.line.part(stretch.from, stretch.to).project(foot);
  std::vector<double> stations{stretch.from - zero};
  for (double s = std::ceil(stations[0] + kLeastApart); s <= stretch.to - zero - kLeastApart; ++s)
    stations.push_back(s);
  stations.push_back(stretch.to - zero);
  LanePart part{lane.name, {}, {kInf, kInf}, {-kInf, -kInf}};
  for (const double s : stations) {
    const LaneRow row = row_at(lane, zero, s);
    const bool again = !part.rows.empty() && norm(row.place - part.rows.back().place) < kLeastApart;
    if (again && s != stations.back()) continue;  // the row is at the position of the previous row
    if (again && part.rows.size() > 1) part.rows.pop_back();
    part.rows.push_back(row);
  }
  for (const LaneRow& row : part.rows) {
    const double half = row.half_width;
    part.low = {std::min(part.low.x, row.place.x - half), std::min(part.low.y, row.place.y - half)};
    part.high = {std::max(part.high.x, row.place.x + half),
                 std::max(part.high.y, row.place.y + half)};
  }
  return part;
}

}  // namespace

bool LanePart::contains(Vec2 point, double beside) const {
  if (point.x < low.x - beside || point.x > high.x + beside || point.y < low.y - beside ||
      point.y > high.y + beside)
    return false;
  // Tests the two pieces at the row nearest to the point, as pyinfra/dataset/regions.py does.
  const auto nearest = std::ranges::min_element(
      rows, {}, [&](const LaneRow& row) { return dot(point - row.place, point - row.place); });
  const auto last = static_cast<std::ptrdiff_t>(rows.size()) - 2;
  double aside = kInf, half_width = 0;
  for (const std::ptrdiff_t before : {1, 0}) {
    const auto piece = std::clamp<std::ptrdiff_t>(nearest - rows.begin() - before, 0, last);
    const LaneRow& a = rows[static_cast<std::size_t>(piece)];
    const LaneRow& b = rows[static_cast<std::size_t>(piece) + 1];
    const Vec2 edge = b.place - a.place;
    const double along = dot(point - a.place, edge) / dot(edge, edge);
    const double t = std::clamp(along, 0.0, 1.0);
    const bool beyond = (piece == 0 && along < 0) || (piece == last && along > 1);
    const double away =
        beyond ? norm(point - (a.place + along * edge)) : norm(point - (a.place + t * edge));
    if (away >= aside) continue;
    aside = away;
    half_width = beyond ? -1 : a.half_width + t * (b.half_width - a.half_width);
  }
  return half_width >= 0 && aside <= half_width + beside;
}

std::vector<LanePart> parts_within(const LanePath& lane, Vec2 foot, double radius) {
  std::vector<LanePart> out;
  for (const Stretch& stretch : stretches_within(lane.line, foot, radius)) {
    LanePart part = part_of(lane, stretch, foot);
    // the part has no length, because the lane turns back
    if (norm(part.rows[1].place - part.rows[0].place) < kLeastApart) continue;
    if (!out.empty()) part.name += "_" + std::to_string(out.size() + 1);
    out.push_back(std::move(part));
  }
  return out;
}

}  // namespace infrasim
