#pragma once

#include <cstddef>
#include <stdexcept>
#include <string>
#include <string_view>

namespace infrasim {

/// Returns the position of the first control character, or of the first byte that is not UTF-8, at
/// or after `from`; npos if there is none.
std::size_t find_unprintable(std::string_view text, std::size_t from = 0);

/// Returns the text as one line that is safe to print in a terminal. Control characters and bytes
/// that are not UTF-8 become \xNN.
std::string printable(std::string_view text);

/// Returns names as a text for messages, such as "a, b, c".
template <class Names>
std::string listed(const Names& names) {
  std::string text;
  for (const auto& name : names) text += (text.empty() ? "" : ", ") + std::string(name);
  return text;
}

/// An error in a configuration or input file. The message is one printable line:
/// `file:line:col: key: expected ..., got ...`.
class ConfigError : public std::runtime_error {
 public:
  explicit ConfigError(std::string_view message) : std::runtime_error(printable(message)) {}
};

/// A file that can't be read or written. The message has the path and the reason.
class IoError : public std::runtime_error {
 public:
  explicit IoError(std::string_view message) : std::runtime_error(printable(message)) {}
};

}  // namespace infrasim
