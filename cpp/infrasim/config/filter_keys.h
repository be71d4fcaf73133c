#pragma once

#include "infrasim/config/scene_config.h"

// Functions that visit the keys of point filters. The template parameter Fields is FieldReader,
// FieldWriter or FieldLister.

namespace infrasim {

/// Visits the keys of an entry of `filters`.
template <class Fields>
void visit(Fields& f, FilterConfig& c);

}  // namespace infrasim
