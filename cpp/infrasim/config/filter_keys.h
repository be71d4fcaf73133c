#pragma once

#include "infrasim/config/scene_config.h"

// Keys of filters. Fields is FieldReader, FieldWriter or FieldLister.

namespace infrasim {

/// Visits the keys of an entry of `filters`.
template <class Fields>
void visit(Fields& f, FilterConfig& c);

}  // namespace infrasim
