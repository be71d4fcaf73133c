#pragma once

#include "infrasim/config/scene_config.h"

// Keys of what stands, lies and grows. Fields is FieldReader, FieldWriter or FieldLister.

namespace infrasim {

/// `meshes` to `vegetation`.
template <class Fields>
void visit_static_objects(Fields& f, SceneConfig& c);

}  // namespace infrasim
