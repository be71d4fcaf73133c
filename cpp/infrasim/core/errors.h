#pragma once

#include <cstddef>
#include <stdexcept>
#include <string>
#include <string_view>

namespace infrasim {

/// Where the text's first control character, or byte that is not UTF-8, stands; npos if nowhere.
std::size_t find_unprintable(std::string_view text, std::size_t from = 0);

/// The text as one line that a terminal shows and does not obey: such bytes become \xNN.
std::string printable(std::string_view text);

/// A wrong configuration or input file. The message is one printable line:
/// `file:line:col: key: what was found, what is allowed`.
class ConfigError : public std::runtime_error {
 public:
  explicit ConfigError(std::string_view message) : std::runtime_error(printable(message)) {}
};

/// A file that can't be read or written. The message names the path and the reason.
class IoError : public std::runtime_error {
 public:
  explicit IoError(std::string_view message) : std::runtime_error(printable(message)) {}
};

}  // namespace infrasim
