#include "infrasim/config/traffic_keys.h"

#include "infrasim/config/fields.h"
#include "infrasim/config/key_list.h"
#include "infrasim/config/shared_keys.h"
#include "infrasim/core/classes.h"

namespace infrasim {

using config::at_least_one;
using config::between;
using config::positive;
using config::required;

template <class Fields>
void visit(Fields& f, SpeedConfig& c) {
  f.field("mean_km_h", c.mean_km_h, "desired speed", required(positive(200)));
  f.field("std_km_h", c.std_km_h, "its standard deviation", between(0, 50));
}

/// Visits the weights of vehicle classes. `why_not` is the error text for other classes.
template <class Fields>
void visit_shares(Fields& f, std::map<std::string, double>& shares, const std::string& why_not) {
  f.field("class_shares", shares, "weight of each object class", [] {
    auto rule = at_least_one();
    rule.min = 0;
    rule.max = 1;
    return rule;
  }());
  double sum = 0;
  for (const auto& [name, share] : shares) {
    const ObjectClass* object_class = find_class(name);
    f.check(object_class != nullptr, "class_shares",
            "expected Car, Van, Truck, Bus, Motorcycle, got unknown class '" + name + "'");
    f.check(object_class == nullptr || object_class->vehicle || share == 0, "class_shares",
            std::string("expected Car, Van, Truck, Bus, Motorcycle, got ")
                .append(name)
                .append(", which ")
                .append(why_not)
                .append("; trajectories may have all"));
    sum += share;
  }
  f.check(sum > 0, "class_shares", "expected above 0, got a sum of 0");
}

template <class Fields>
void visit(Fields& f, TrafficConfig& c) {
  f.here(c.place);
  f.field("vehicles_per_km_lane", c.vehicles_per_km_lane, "density", required(between(0, 100)));
  f.field("speed", c.speed, "desired speeds", required());
  f.field("warm_up_s", c.warm_up_s, "driven before frame 0", between(0, 1e4));
  visit_shares(f, c.class_shares, "has no speed and way of its own in traffic");
  double sum = 0, sum_of_lengths = 0;
  for (const auto& [name, share] : c.class_shares) {
    sum += share;
    if (const ObjectClass* object_class = find_class(name))
      sum_of_lengths += share * object_class->length_m.mean;
  }
  const double most = std::floor(1000 / (sum_of_lengths / sum + kStandstillGap_m));
  f.check(!(c.vehicles_per_km_lane > most), "vehicles_per_km_lane",
          "expected up to " + config::number_text(most) + ", vehicles of these classes with " +
              config::number_text(kStandstillGap_m) + " m between them, got " +
              config::number_text(c.vehicles_per_km_lane));
}

template <class Fields>
void visit(Fields& f, ParkedConfig& c) {
  f.here(c.place);
  visit_side(f, c);
  visit_stations(f, c);
  f.field("turn_deg", c.turn_deg, "of the vehicles from the road's direction", between(-90, 90));
  f.field("gap_m", c.gap_m, "mean of the gaps between two", between(0.2, 1000));
  f.field("occupied", c.occupied, "share of the places that a vehicle stands in", between(0, 1));
  f.field("base_m", c.base_m, "their base above the road", between(-100, 100));
  visit_shares(f, c.class_shares, "is no vehicle");
}

template <class Fields>
void visit(Fields& f, PersonSpeedConfig& c) {
  f.field("mean_km_h", c.mean_km_h, "mean of their own speeds", required(between(1, 50)));
  f.field("std_km_h", c.std_km_h, "its standard deviation, at most a third of the mean",
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
  f.field("per_km", c.per_km, "how many on a kilometre of the line, both ways together",
          required(between(0, 60)));
  f.field("class", c.kind, "on foot or on bicycles", required());
  f.field("speed", c.speed, "constant, everybody's own", required());
}

template <class Fields>
void visit(Fields& f, StandingPeopleConfig& c) {
  f.here(c.place);
  f.field("x_m", c.x_m, "world x of the middle of the group", required());
  f.field("y_m", c.y_m, "world y of the middle of the group", required());
  f.field("count", c.count, "pedestrians of the group", between(1, 50));
  f.field("spacing_m", c.spacing_m, "mean distance between neighbours", between(1.2, 5));
  f.field("base_m", c.base_m, "world z that they stand on", between(-1e3, 1e4));
}

template <class Fields>
void visit_traffic(Fields& f, SceneConfig& c) {
  f.field("traffic", c.traffic, "simulated vehicles");
  f.field("parked", c.parked, "rows of standing vehicles along roads");
  f.field("people", c.people, "on foot and on bicycles along roads");
  f.field("standing_people", c.standing_people, "groups of pedestrians who stand");
  f.field("trajectories", c.trajectories, "file of recorded vehicles instead of traffic");
}

template void visit_traffic(config::FieldReader&, SceneConfig&);
template void visit_traffic(config::FieldWriter&, SceneConfig&);
template void visit_traffic(config::FieldLister&, SceneConfig&);

}  // namespace infrasim
