#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "infrasim/pipeline/run.h"

namespace infrasim::cli {

/// Parses a frame range A:B or A:B:STEP, which excludes frame B. B is at most `frames`.
/// @param reason why B can't be larger than `frames`, for the message
/// @throws ConfigError if the text is not such a range
FrameRange parse_frames(const std::string& text, int frames, const std::string& reason = "");

/// @throws ConfigError if the text is not a whole number of 0 or more
std::uint64_t parse_seed(const std::string& text);

/// Refuses an output file that the command has read.
/// @param option the option of the output file, for the message
/// @throws ConfigError
void refuse_input(const char* option, const std::filesystem::path& file);

}  // namespace infrasim::cli
