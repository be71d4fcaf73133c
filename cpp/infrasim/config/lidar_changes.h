#pragma once

#include <string>

#include "infrasim/config/lidar_config.h"

namespace infrasim {

/// Returns the LiDAR with another number of frames per second. The firing cycle of a spinning unit
/// does not change, so the number of columns per turn changes.
/// @throws ConfigError if the rate is out of range, or gives no short fraction of columns
LidarConfig with_rate(LidarConfig lidar, double rate_hz);

/// Sets `law_exponent` of the units with one published range. The published ranges of the other
/// units determine the exponent.
/// @return whether any unit has changed
/// @throws ConfigError for an exponent that is not allowed
bool set_law_exponent(LidarConfig& lidar, double exponent);
/// Returns the mode with a name.
/// @throws ConfigError for an unknown name
EchoMode echo_mode(const std::string& name);

/// Sets the echo mode of all units.
/// @throws ConfigError if a unit does not detect by received power, or does not offer the mode
void set_echo_mode(LidarConfig& lidar, EchoMode mode);

}  // namespace infrasim
