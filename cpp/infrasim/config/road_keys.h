#pragma once

#include "infrasim/config/scene_config.h"

// Keys of roads, how they lie and how they join. Fields is FieldReader, FieldWriter or FieldLister.

namespace infrasim {

/// `lanes`, `roads` and `profile`.
template <class Fields>
void visit_ways(Fields& f, SceneConfig& c);

/// `junctions`.
template <class Fields>
void visit_junctions(Fields& f, SceneConfig& c);

}  // namespace infrasim
