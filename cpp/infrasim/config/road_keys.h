#pragma once

#include "infrasim/config/scene_config.h"

// Functions that visit the keys of roads, their profile and their junctions. The template parameter
// Fields is FieldReader, FieldWriter or FieldLister.

namespace infrasim {

/// Visits the keys `lanes`, `roads` and `profile`.
template <class Fields>
void visit_ways(Fields& f, SceneConfig& c);

/// Visits the key `junctions`.
template <class Fields>
void visit_junctions(Fields& f, SceneConfig& c);

}  // namespace infrasim
