#pragma once

#include <cstdint>
#include <string>

#include "infrasim/pipeline/run.h"

namespace infrasim::cli {

/// A:B or A:B:STEP, B excluded.
/// @throws ConfigError
FrameRange parse_frames(const std::string& text);

/// @throws ConfigError
std::uint64_t parse_seed(const std::string& text);

}  // namespace infrasim::cli
