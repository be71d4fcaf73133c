#include "infrasim/core/version.h"

namespace infrasim {

std::string_view version() { return INFRASIM_VERSION; }

}  // namespace infrasim
