#pragma once

#include "infrasim/config/scene_config.h"

// Functions that visit the keys of traffic, parked vehicles, pedestrians and cyclists. The template
// parameter Fields is FieldReader, FieldWriter or FieldLister.

namespace infrasim {

/// Visits the keys from `traffic` to `trajectories`.
template <class Fields>
void visit_traffic(Fields& f, SceneConfig& c);

}  // namespace infrasim
