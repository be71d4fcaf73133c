#pragma once

#include <string_view>

namespace infrasim {

/// Version of the package, as `pyproject.toml` has it.
std::string_view version();

}  // namespace infrasim
