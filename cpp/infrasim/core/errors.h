#pragma once

#include <stdexcept>
#include <string>

namespace infrasim {

/// A wrong configuration or input file. The message is one line:
/// `file:line:col: key: what was found, what is allowed`.
class ConfigError : public std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// A file that can't be read or written. The message names the path and the reason.
class IoError : public std::runtime_error {
  using std::runtime_error::runtime_error;
};

}  // namespace infrasim
