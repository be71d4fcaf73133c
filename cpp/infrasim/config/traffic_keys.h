#pragma once

#include "infrasim/config/scene_config.h"

// Keys of who drives, stands parked and walks. Fields is FieldReader, FieldWriter or FieldLister.

namespace infrasim {

/// `traffic` to `trajectories`.
template <class Fields>
void visit_traffic(Fields& f, SceneConfig& c);

}  // namespace infrasim
