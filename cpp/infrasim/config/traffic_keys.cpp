#include "infrasim/config/scene_keys.h"

#include "infrasim/core/classes.h"

namespace infrasim {

using config::at_least_one;
using config::between;
using config::positive;
using config::required;

template <class Fields>
void visit(Fields& f, SpeedConfig& c) {
  f.field("mean_km_h", c.mean_km_h, "mean of the desired speeds", required(positive(200)));
  f.field("std_km_h", c.std_km_h, "standard deviation of the speeds", between(0, 50));
}

/// Visits the shares of the vehicle classes. `why_not` is the part of the error message that says
/// why other classes are not allowed.
template <class Fields>
void visit_shares(Fields& f, std::map<std::string, double>& shares, const std::string& why_not) {
  const std::string vehicles = "Car, Van, Truck, Bus, Motorcycle";
  f.field("class_shares", shares, "relative frequency of each object class", [&] {
    auto rule = at_least_one();
    rule.min = 0;
    rule.max = 1;
    rule.keys = vehicles.c_str();
    return rule;
  }());
  double sum = 0;
  for (const auto& [name, share] : shares) {
    const ObjectClass* object_class = find_class(name);
    f.check(object_class != nullptr, "class_shares",
            "expected " + vehicles + ", got unknown class '" + name + "'");
    f.check(object_class == nullptr || object_class->vehicle || share == 0, "class_shares",
            "expected " + vehicles + ", got " + name + ", which " + why_not +
                "; trajectories may have all classes");
    sum += share;
  }
  f.check(sum > 0, "class_shares", "expected above 0, got a sum of 0");
}

template <class Fields>
void visit(Fields& f, TrafficConfig& c) {
  f.here(c.place);
  f.field("vehicles_per_km_lane", c.vehicles_per_km_lane, "density of the traffic",
          required(between(0, 100)));
  f.field("speed", c.speed, "desired speeds", required());
  f.field("warm_up_s", c.warm_up_s, "time for which the traffic is simulated before frame 0",
          between(0, 1e4));
  visit_shares(f, c.class_shares, "is not simulated as traffic on lanes");
  double sum = 0, sum_of_lengths = 0;
  for (const auto& [name, share] : c.class_shares) {
    sum += share;
    if (const ObjectClass* object_class = find_class(name))
      sum_of_lengths += share * object_class->length_m.mean;
  }
  const double most = std::floor(1000 / (sum_of_lengths / sum + kStandstillGap_m));
  f.check(!(c.vehicles_per_km_lane > most), "vehicles_per_km_lane",
          "expected up to " + config::number_text(most) +
              ", the density of these vehicle classes with gaps of " +
              config::number_text(kStandstillGap_m) + " m, got " +
              config::number_text(c.vehicles_per_km_lane));
}

template <class Fields>
void visit(Fields& f, ParkedConfig& c) {
  f.here(c.place);
  visit_side(f, c);
  visit_stations(f, c);
  f.field("turn_deg", c.turn_deg, "angle between the vehicles and the direction of the road",
          between(-90, 90));
  f.field("gap_m", c.gap_m, "mean gap between two vehicles", between(0.2, 1000));
  f.field("occupied", c.occupied, "share of the parking spaces that are occupied", between(0, 1));
  f.field("base_m", c.base_m, "height of their base above the road", between(-100, 100));
  visit_shares(f, c.class_shares, "is no vehicle");
}

template <class Fields>
void visit(Fields& f, PersonSpeedConfig& c) {
  f.field("mean_km_h", c.mean_km_h, "mean of the speeds", required(between(1, 50)));
  f.field("std_km_h", c.std_km_h, "standard deviation of the speeds, at most a third of the mean",
          required(between(0, 20)));
  f.check(!(3 * c.std_km_h > c.mean_km_h), "std_km_h",
          "expected up to a third of mean_km_h, so that everybody moves, got " +
              config::number_text(c.std_km_h));
}

template <class Fields>
void visit(Fields& f, PeopleConfig& c) {
  f.here(c.place);
  visit_side(f, c);
  visit_stations(f, c);
  f.field("per_km", c.per_km, "number per kilometre, in both directions together",
          required(between(0, 60)));
  f.field("class", c.kind, "object class", required());
  f.field("speed", c.speed, "speeds; each person keeps one constant speed", required());
}

template <class Fields>
void visit(Fields& f, StandingPeopleConfig& c) {
  f.here(c.place);
  f.field("x_m", c.x_m, "world x of the centre of the group", required());
  f.field("y_m", c.y_m, "world y of the centre of the group", required());
  f.field("count", c.count, "number of pedestrians in the group", between(1, 50));
  f.field("spacing_m", c.spacing_m, "mean distance between neighbours", between(1.2, 5));
  f.field("base_m", c.base_m, "world z of the ground under the group", between(-1e3, 1e4));
}

template <class Fields>
void visit_traffic(Fields& f, SceneConfig& c) {
  f.field("traffic", c.traffic, "simulated vehicles");
  f.field("parked", c.parked, "rows of parked vehicles along roads");
  f.field("people", c.people, "pedestrians and cyclists who move along roads");
  f.field("standing_people", c.standing_people, "groups of standing pedestrians");
  f.field("trajectories", c.trajectories, "file of trajectories, which replaces simulated traffic");
  f.here(c.trajectories_key, "trajectories");
}

template void visit_traffic(config::FieldReader&, SceneConfig&);
template void visit_traffic(config::FieldWriter&, SceneConfig&);
template void visit_traffic(config::FieldLister&, SceneConfig&);

}  // namespace infrasim
