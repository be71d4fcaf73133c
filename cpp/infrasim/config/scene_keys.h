#pragma once

#include <string>

#include "infrasim/config/fields.h"
#include "infrasim/config/key_list.h"
#include "infrasim/config/scene_config.h"

// Functions that visit the keys of a scene file: each function passes keys and their values to a
// Fields object. Fields is FieldReader, which reads the values, FieldWriter, which writes them, or
// FieldLister, which lists the keys.

namespace infrasim {

/// Visits the keys of an entry of `filters`.
template <class Fields>
void visit(Fields& f, FilterConfig& c);

/// Visits the keys `lanes`, `roads` and `profile`.
template <class Fields>
void visit_ways(Fields& f, SceneConfig& c);

/// Visits the key `junctions`.
template <class Fields>
void visit_junctions(Fields& f, SceneConfig& c);

/// Visits the keys from `meshes` to `vegetation`.
template <class Fields>
void visit_static_objects(Fields& f, SceneConfig& c);

/// Visits the keys from `traffic` to `trajectories`.
template <class Fields>
void visit_traffic(Fields& f, SceneConfig& c);

/// Checks a name that is written into tables.
template <class Fields>
void check_name(Fields& f, const std::string& name) {
  f.check(name.find(',') == std::string::npos && name.size() <= 100, "name",
          "expected a short name, got a comma or more than 100 letters");
  f.check(config::begins_as_name(name), "name",
          "expected a name that begins with a letter, a digit or _, got '" + name + "'");
}

/// Visits the keys that give an object's position beside a road.
template <class Fields, class Config>
void visit_side(Fields& f, Config& c, const char* road = "name of its road") {
  f.field("road", c.road, road, config::required());
  f.field("offset_m", c.offset_m, "offset from the centreline, positive to the left",
          config::required(config::between(-100, 100)));
}

/// Visits the keys that limit an object to a part of its road.
template <class Fields, class Config>
void visit_stations(Fields& f, Config& c, const char* from = "first station of the centreline") {
  f.field("from_m", c.from_m, from, config::between(0, 1e5));
  f.field("to_m", c.to_m, "last station, at most the road's end", config::between(0, 1e9));
}

}  // namespace infrasim
