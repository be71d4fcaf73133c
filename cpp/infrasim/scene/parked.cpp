#include "infrasim/scene/parked.h"

#include <algorithm>

#include "infrasim/config/fields.h"
#include "infrasim/core/math.h"
#include "infrasim/core/rng.h"
#include "infrasim/scene/fleet.h"
#include "infrasim/scene/roads.h"

namespace infrasim {

namespace {

constexpr double kAside_m = 0.15;  // assumed maximum lateral offset of a vehicle from its row
constexpr double kAskew_deg = 2;   // maximum rotation of a vehicle from its row's direction
constexpr std::size_t kMost =
    2'000;  // maximum number of vehicles per scene, because each is processed in every frame
// number of the first random sample after those of class and size
constexpr unsigned kAfterParkedSize = 7;

class Row {
 public:
  Row(const Road& road, const ParkedConfig& config, std::size_t index, Rng rng)
      : config_(config),
        index_(index),
        rng_(rng),
        line_(line_beside(road.centreline, config)),
        road_(road.config) {}

  void append_to(std::vector<ParkedVehicle>& out) const {
    double s = 0;
    for (std::uint64_t place = 1;; ++place) {
      const Rng rng = rng_.at(place);
      const ObjectClass& kind = class_at(config_.class_shares, rng.uniform(0));
      const VehicleSize size = sample_size(kind, rng);
      const double askew = rad(kAskew_deg) * (2 * rng.uniform(kAfterParkedSize) - 1);
      const double turn = rad(config_.turn_deg) + askew;
      const double taken =
          std::abs(math::cos(turn)) * size.dx + std::abs(math::sin(turn)) * size.dy;
      if (s + taken > line_.length()) return;
      if (rng.uniform(kAfterParkedSize + 1) < config_.occupied) {
        if (out.size() == kMost)
          config::fail(config_.place, "to_m",
                       "expected at most " + std::to_string(kMost) +
                           " parked vehicles up to this row, got more");
        const int id = kFirstParkedId + static_cast<int>(out.size());
        out.push_back({state(id, kind, size, s + taken / 2, turn, rng), index_});
      }
      s += taken + config_.gap_m * (0.6 + 0.8 * rng.uniform(kAfterParkedSize + 2));
    }
  }

 private:
  ObjectState state(int id, const ObjectClass& kind, const VehicleSize& size, double s, double turn,
                    const Rng& rng) const {
    const CurvePoint p = line_.at(s);
    const double aside = kAside_m * (2 * rng.uniform(kAfterParkedSize + 3) - 1);
    const Vec2 xy = p.position + aside * heading_vector(p.heading + kPi / 2);
    const bool along = config_.turn_deg == 0;
    const bool back = along ? config_.offset_m > 0 : rng.uniform(kAfterParkedSize + 4) < 0.5;
    const double z = road_.elevation_m + config_.base_m + size.dz / 2;
    const double heading = p.heading + turn + (back ? kPi : 0);
    return rounded({id, kind.id, {xy.x, xy.y, z, size.dx, size.dy, size.dz, heading}, 0});
  }

  const ParkedConfig& config_;
  std::size_t index_;  ///< position in the list of rows
  Rng rng_;
  Curve line_;  ///< line through the centres of the vehicles
  const RoadConfig& road_;
};

}  // namespace

std::vector<ParkedVehicle> parked_vehicles(const SceneConfig& scene,
                                           std::span<const Curve> centrelines) {
  std::vector<ParkedVehicle> out;
  if (!scene.parked) return out;
  const Rng rng = Rng::of(scene.seed, "parked");
  for (std::size_t i = 0; i < scene.parked->size(); ++i) {
    const ParkedConfig& row = (*scene.parked)[i];
    Row(road_named(scene, centrelines, row.road, row.place), row, i, rng.at(i + 1)).append_to(out);
  }
  return out;
}

}  // namespace infrasim
