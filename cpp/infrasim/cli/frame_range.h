#pragma once

#include <cstdint>
#include <string>

#include "infrasim/pipeline/run.h"

namespace infrasim::cli {

/// A:B or A:B:STEP, B excluded, of the frames in so many seconds.
/// @throws ConfigError
FrameRange parse_frames(const std::string& text, double duration_s);

/// @throws ConfigError
std::uint64_t parse_seed(const std::string& text);

}  // namespace infrasim::cli
