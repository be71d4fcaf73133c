#pragma once

#include "infrasim/config/scene_config.h"

// Functions that visit the keys of static objects and vegetation. The template parameter Fields is
// FieldReader, FieldWriter or FieldLister.

namespace infrasim {

/// Visits the keys from `meshes` to `vegetation`.
template <class Fields>
void visit_static_objects(Fields& f, SceneConfig& c);

}  // namespace infrasim
