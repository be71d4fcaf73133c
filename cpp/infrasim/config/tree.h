#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "infrasim/core/errors.h"

namespace infrasim::config {

/// Source position of a value: `file:line:col`, or the option that set it.
struct Place {
  std::string file;
  int line = 0;  ///< line number, counted from 1; 0 for a value without a line
  int column = 0;
};

/// Position and dotted path of a key that names a file.
struct KeyPlace {
  Place place;
  std::string key;
};

/// One parsed YAML value. A map keeps its keys in file order and without duplicates.
struct Tree {
  enum class Kind { kNull, kScalar, kSequence, kMap };
  Kind kind = Kind::kNull;
  std::string scalar;
  std::vector<std::string> keys;  ///< keys of a map, one for each of `items`
  std::vector<Tree> items;        ///< values of a map or sequence
  Place place;

  const Tree* find(std::string_view key) const;
};

/// Removes a key from a map and returns its value; nothing if the key is missing.
std::optional<Tree> take(Tree& map, std::string_view key);

/// Throws an error with the message "file:line:col: key: what" in one line.
[[noreturn]] void fail(const Place& place, std::string_view key, std::string_view what);

/// Returns the start "file:line:col: key: " of a message.
std::string start_of(const KeyPlace& at);

/// Calls a function that reads the file that a key names. If the file can't be read, the error
/// names the key and its position too.
template <class Read>
auto read_named(const KeyPlace& at, const Read& read) {
  try {
    return read();
  } catch (const IoError& error) {
    throw IoError((at.key.empty() ? "" : start_of(at)) + error.what());
  }
}

/// @throws ConfigError on malformed YAML, duplicate keys, or aliases that expand the file too much
/// @throws IoError if the file can't be read
Tree read_tree(const std::filesystem::path& file);
Tree parse_tree(const std::string& text, const std::string& name);

/// Returns `base` with the values of `over`. Maps are merged key by key.
Tree merged(const Tree& base, const Tree& over);

/// Sets the value at a dotted path (`mounts.pole.z_m`, `roads.0.name`), as `--set KEY=VALUE` does.
/// Missing maps on the path are created. read_struct checks later whether the key exists.
/// @throws ConfigError if the assignment is malformed or a list index is out of range
void override_value(Tree& root, const std::string& assignment);

}  // namespace infrasim::config
