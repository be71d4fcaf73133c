#include "infrasim/scene/traffic_checks.h"

#include <algorithm>
#include <cmath>

#include "infrasim/config/fields.h"
#include "infrasim/core/math.h"
#include "infrasim/scene/parked.h"

namespace infrasim {

namespace {

// The rules of simulated traffic prevent overlaps. Therefore only the first minute of simulated
// traffic is tested for overlaps, as in `infrasim check --traffic`.
constexpr int kSimulatedInstants = 601;
constexpr int kHeightEvery = 10;  // number of instants between two tests of a vehicle's height
// maximum plausible height of a vehicle above or below its lane
constexpr double kOffLane_m = 1;
constexpr double kMovement_m = 0.5;   // minimum movement from which a direction is derived
constexpr double kSideways_deg = 30;  // maximum plausible angle between heading and movement
constexpr int kFewestMovements = 4;   // minimum number of movements for a warning

std::string rounded_text(double value) {
  return config::number_text(std::round(value * 100) / 100);
}

std::string time_and_place(int instant, Vec2 place) {
  return rounded_text(instant * kRowStep_s) + " s, " + at_text(place);
}

/// Returns the text "N of M vehicles" of a message.
std::string share_text(std::size_t count, std::size_t of) {
  return std::to_string(count) + " of " + std::to_string(of) + " vehicles";
}

}  // namespace

std::string overlap_text(const std::vector<Overlap>& overlaps) {
  const Overlap& first = overlaps.front();
  const std::string others =
      overlaps.size() == 1 ? "" : " (" + std::to_string(overlaps.size()) + " pairs in all)";
  return "(vehicles): expected vehicles apart, got " + std::to_string(first.first_id) + " and " +
         std::to_string(first.second_id) + " in one place at " + rounded_text(first.time_s) +
         " s, x " + rounded_text(first.place.x) + ", y " + rounded_text(first.place.y) + others;
}

TrafficChecks::TrafficChecks(const Site& site) : site_(site) {
  if (!site.scene.traffic) add_lanes();
}

void TrafficChecks::add_lanes() {
  const auto add = [&](const Curve& line, double half_width, const auto& level_at) {
    std::vector<Strip> strips = cut_into_strips(line, half_width, -half_width, 0);
    for (Strip& strip : strips) {
      strip.of = levels_.size();
      levels_.push_back(level_at(strip));
    }
    strips_.add(strips);
  };
  for (const Lane& lane : site_.network.lanes)
    add(lane.curve, lane.width_m / 2,
        [&](const Strip& strip) { return lane.elevation_m + site_.profile.rise(strip.middle()); });
  for (const LanePath& lane : site_.lanes)
    add(lane.line, std::ranges::max(lane.width_m) / 2,
        [&](const Strip& strip) { return lane.at(lane.z, (strip.from + strip.to) / 2); });
}

void TrafficChecks::take(const std::vector<ObjectState>& states) {
  if (!site_.scene.traffic || instant_ < kSimulatedInstants) overlaps_.take(states);
  if (!site_.scene.traffic)
    for (const ObjectState& state : states)
      if (state.id < kFirstParkedId && state.object_class != Class::kPedestrian) test(state);
  ++instant_;
}

void TrafficChecks::test(const ObjectState& state) {
  const auto [entry, is_new] = tracks_.try_emplace(state.id);
  Track& track = entry->second;
  if (is_new) {
    track.last = state.box;
    track.wide = state.box.dy > state.box.dx;
  }
  test_motion(state.box, track);
  if (track.first_off >= 0 || (!is_new && instant_ - track.sampled < kHeightEvery)) return;
  track.sampled = instant_;
  test_height(state.box, track);
}

/// Compares the heading with the direction of the last movement. Vehicles that reverse, and boxes
/// that point backwards, are accepted.
void TrafficChecks::test_motion(const Box3d& box, Track& track) const {
  const Vec2 step{box.x - track.last.x, box.y - track.last.y};
  if (norm(step) < kMovement_m) return;
  ++track.movements;
  if (std::abs(cross(heading_vector(track.last.heading), step)) >
          math::sin(rad(kSideways_deg)) * norm(step) &&
      track.sideways++ == 0) {
    track.first_sideways = instant_;
    track.sideways_at = {box.x, box.y};
  }
  track.last = box;
}

/// Compares the bottom of a vehicle with the lanes below and above it. Vehicles beside all lanes
/// are accepted.
void TrafficChecks::test_height(const Box3d& box, Track& track) const {
  const auto outline = footprint(box);
  const double bottom = box.z - box.dz / 2;
  double off = kInf;
  strips_.first_met(outline, [&](const Strip& strip) {
    const double above = bottom - levels_[strip.of];
    if (std::abs(above) < std::abs(off) && footprints_overlap(outline, strip.outline)) off = above;
    return false;
  });
  if (!std::isfinite(off) || std::abs(off) <= kOffLane_m) return;
  track.above_m = off;
  track.first_off = instant_;
  track.off_at = {box.x, box.y};
}

std::vector<std::string> TrafficChecks::warnings() const {
  std::vector<std::string> lines;
  const SceneConfig& scene = site_.scene;
  const std::string file =
      scene.traffic ? scene.name : (scene.folder / scene.trajectories).string();
  if (!overlaps_.overlaps().empty())
    lines.push_back("traffic: " + file + ": " + overlap_text(overlaps_.overlaps()));
  const auto add = [&](const std::string& key, const auto& is_found, const auto& describe) {
    const auto count =
        std::ranges::count_if(tracks_, [&](const auto& entry) { return is_found(entry.second); });
    if (count == 0) return;
    const auto& [id, track] =
        *std::ranges::find_if(tracks_, [&](const auto& entry) { return is_found(entry.second); });
    lines.push_back("traffic: " + file + ": " + key + ", got " +
                    share_text(static_cast<std::size_t>(count), tracks_.size()) +
                    describe(std::to_string(id), track));
  };
  add(
      "z: expected vehicles within " + rounded_text(kOffLane_m) + " m of the height of a lane",
      [](const Track& track) { return track.first_off >= 0; },
      [](const std::string& id, const Track& track) {
        return " above or below, such as " + id + " at " +
               time_and_place(track.first_off, track.off_at) + ", which is " +
               rounded_text(std::abs(track.above_m)) + " m " +
               (track.above_m > 0 ? "above" : "below");
      });
  add(
      "heading: expected the direction of motion, in radians from x to y",
      [](const Track& track) {
        return track.movements >= kFewestMovements && 2 * track.sideways > track.movements;
      },
      [](const std::string& id, const Track& track) {
        return " that drive sideways, such as " + id + " at " +
               time_and_place(track.first_sideways, track.sideways_at);
      });
  add(
      "dx: expected the length of a vehicle, and dy its width",
      [](const Track& track) { return track.wide; },
      [](const std::string& id, const Track& track) {
        return " that are wider than long, such as " + id + " of " + rounded_text(track.last.dx) +
               " by " + rounded_text(track.last.dy) + " m";
      });
  return lines;
}

}  // namespace infrasim
