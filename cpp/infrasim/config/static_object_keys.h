#pragma once

#include "infrasim/config/static_objects_config.h"

// Keys of static objects and vegetation. Fields is FieldReader, FieldWriter or FieldLister.

namespace infrasim {

/// Visits the keys from `meshes` to `vegetation`.
template <class Fields>
void visit_static_objects(Fields& f, SceneConfig& c);

}  // namespace infrasim
