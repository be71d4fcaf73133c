#pragma once

#include <string>

#include "infrasim/config/lidar_config.h"

namespace infrasim {

/// Returns the LiDAR with `rate_hz` frames per second. The firing cycle of a spinning unit does not
/// change, so the number of columns per turn changes.
/// @throws ConfigError if the rate is out of range, or if its ratio to the previous rate is not a
///   short fraction
LidarConfig with_rate(LidarConfig lidar, double rate_hz);

/// Sets `law_exponent` of the LiDAR units with only one published range. The published ranges of
/// the other units determine their exponent.
/// @return whether any unit has changed
/// @throws ConfigError for an exponent that is not allowed
bool set_law_exponent(LidarConfig& lidar, double exponent);
/// Returns the echo mode with the given name.
/// @throws ConfigError for an unknown name
EchoMode echo_mode(const std::string& name);

/// Sets the echo mode of all units.
/// @throws ConfigError if a unit does not offer the mode; units that do not detect by received
///   power offer only `strongest`
void set_echo_mode(LidarConfig& lidar, EchoMode mode);

}  // namespace infrasim
