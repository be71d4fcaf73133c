#pragma once

#include <algorithm>
#include <charconv>
#include <cmath>
#include <optional>
#include <span>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "infrasim/config/canonical_keys.h"
#include "infrasim/config/tree.h"
#include "infrasim/core/fraction.h"
#include "infrasim/core/geometry.h"

// Each configuration struct has one function `visit(fields, struct)` that names its keys. A
// FieldReader fills the struct from a Tree. A FieldWriter prints the struct as YAML, including keys
// with default values. The words of an enum come from `enum_names(Enum)`, declared beside the enum.

namespace infrasim::config {

/// The allowed values of a key. A missing required key is an error; any other missing key keeps its
/// default.
struct Rule {
  double min = -1e9;
  double max = 1e9;
  bool above_min = false;  ///< whether the minimum itself is forbidden
  bool required = false;
  std::size_t min_items = 0;   ///< minimum number of items of a list or map
  const char* keys = nullptr;  ///< the keys of a map by name, for messages
};
inline Rule between(double min, double max) { return {min, max}; }
inline Rule positive(double max = 1e9) { return {0, max, true}; }
inline Rule required(Rule rule = {}) {
  rule.required = true;
  return rule;
}
inline Rule at_least_one() { return {-1e9, 1e9, false, true, 1}; }

/// Returns the shortest text that is parsed as the same number.
std::string number_text(double value);

/// Returns a name as it is written in YAML: in quotes if it has other characters than letters,
/// digits and _, or if YAML readers would read it as a number, a boolean or null.
std::string quoted_name(const std::string& name);

/// Returns whether a text begins with a letter, a digit or _. Shells and spreadsheets give a
/// special meaning to other first characters, as in -rf and =1+1.
bool begins_as_name(const std::string& text);

/// @throws ConfigError if the value is not a map
void expect_map(const Tree& tree, const std::string& key);

/// Removes `presets` from a file's tree and returns it: a map from preset names to blocks of keys.
/// Returns nothing if the file has no presets.
/// @throws ConfigError if `presets` is not a map
std::optional<Tree> take_presets(Tree& tree);

/// A std::map or a NamedMap, with names as keys.
template <class T>
concept Map = requires { typename T::mapped_type; };

template <class T>
concept Struct = std::is_class_v<T> && !Map<T> && !std::is_same_v<T, std::string> &&
                 !std::is_same_v<T, Vec2> && !std::is_same_v<T, Fraction>;

class FieldReader {
 public:
  FieldReader(const Tree& map, std::string path) : map_(map), path_(std::move(path)) {}
  /// @throws ConfigError if the tree is not a map, has an unknown key, or failed a check; the
  ///   message names the first check that failed
  void finish() const;

  template <class T>
  void field(const char* key, T& value, const char* /*doc*/, Rule rule = {}) {
    if (const Tree* tree = take(key, rule)) read(*tree, full(key), value, rule);
  }
  /// Stores the position of the struct in the file, for messages of checks that need other parts of
  /// the scene.
  void here(Place& place) const { place = map_.place; }
  /// Stores the position and the path of a key that names a file, for messages about the file.
  void here(KeyPlace& at, const char* key) const {
    const Tree* value = map_.find(key);
    at = {value == nullptr ? map_.place : value->place, full(key)};
  }
  /// Makes `finish` fail at the key's position if the condition does not hold. `finish` reports an
  /// unknown key before a missing required key, because the unknown key is often a misspelling of
  /// the missing one.
  void check(bool holds, const char* key, const std::string& what);

 private:
  const Tree* take(const char* key, const Rule& rule);
  std::string full(const char* key) const { return path_.empty() ? key : path_ + "." + key; }

  static void read(const Tree& tree, const std::string& key, double& value, const Rule& rule);
  static void read(const Tree& tree, const std::string& key, int& value, const Rule& rule);
  static void read(const Tree& tree, const std::string& key, std::uint64_t& value, const Rule&);
  static void read(const Tree& tree, const std::string& key, bool& value, const Rule&);
  static void read(const Tree& tree, const std::string& key, std::string& value, const Rule& rule);
  static void read(const Tree& tree, const std::string& key, Vec2& value, const Rule& rule);
  static void read(const Tree& tree, const std::string& key, Fraction& value, const Rule& rule);
  static std::size_t read_name(const Tree& tree, const std::string& key,
                               std::span<const char* const> names);
  static void expect(const Tree& tree, Tree::Kind kind, const std::string& key,
                     const std::string& what);
  static void expect_items(const Tree& tree, const std::string& key, const Rule& rule);
  static void refuse_commas(const Tree& map, const std::string& path);

  template <class E>
    requires std::is_enum_v<E>
  static void read(const Tree& tree, const std::string& key, E& value, const Rule&) {
    value = static_cast<E>(read_name(tree, key, enum_names(E{})));
  }
  template <Struct T>
  static void read(const Tree& tree, const std::string& key, T& value, const Rule&) {
    FieldReader reader(tree, key);
    visit(reader, value);
    reader.finish();
  }
  template <class T>
  static void read(const Tree& tree, const std::string& key, std::optional<T>& value,
                   const Rule& rule) {
    if (tree.kind == Tree::Kind::kNull) return;
    read(tree, key, value.emplace(), rule);
  }
  template <class T>
  static void read(const Tree& tree, const std::string& key, std::vector<T>& value,
                   const Rule& rule) {
    expect(tree, Tree::Kind::kSequence, key, "a list");
    expect_items(tree, key, rule);
    value.clear();
    for (std::size_t i = 0; i < tree.items.size(); ++i)
      read(tree.items[i], key + "." + std::to_string(i), value.emplace_back(), rule);
  }
  template <Map T>
  static void read(const Tree& tree, const std::string& key, T& value, const Rule& rule) {
    expect(tree, Tree::Kind::kMap, key,
           rule.keys == nullptr ? "a map" : std::string("a map with the keys ") + rule.keys);
    expect_items(tree, key, rule);
    refuse_commas(tree, key);
    value.clear();
    for (std::size_t i = 0; i < tree.items.size(); ++i)
      read(tree.items[i], key + "." + tree.keys[i], value[tree.keys[i]], rule);
  }

  const Tree& map_;
  std::string path_;
  std::vector<std::string> taken_;
  std::optional<std::pair<const char*, std::string>> failed_check_;
};

class FieldWriter {
 public:
  FieldWriter() = default;
  /// Makes a writer that writes the canonical names of keys (those of version 0.3), and omits keys
  /// that were added later and have their default value.
  explicit FieldWriter(const CanonicalKeys& canonical) : canonical_(canonical) {}

  template <class T>
  void field(const char* key, T& value, const char* /*doc*/, Rule = {}) {
    entry(key, value, &FieldWriter::canonical_name);
  }
  template <class T>
  void field(const char* key, std::optional<T>& value, const char* /*doc*/, Rule = {}) {
    if (value) entry(key, *value, &FieldWriter::canonical_name);
  }
  void here(const Place&) const {}
  void here(const KeyPlace&, const char*) const {}
  void check(bool, const char*, const std::string&) const {}

  std::string text() const { return text_.starts_with('\n') ? text_.substr(1) : text_; }

 private:
  /// @param name function that returns the name under which a key is written
  template <class T>
  void entry(const std::string& key, T& value,
             std::string (FieldWriter::*name)(const std::string&) const) {
    const std::size_t path = path_.size(), before = text_.size();
    path_ += "." + key;
    text_ += "\n" + std::string(indent_, ' ') + (this->*name)(key) + ":";
    const std::size_t written = text_.size();
    write(value);
    if (is_left_out(std::string_view(text_).substr(written))) text_.resize(before);
    path_.resize(path);
  }
  std::string canonical_name(const std::string& key) const;
  std::string quoted_key(const std::string& key) const { return quoted_name(key); }
  bool is_left_out(std::string_view value) const;
  void write(double value) { text_ += " " + number_text(value); }
  void write(int value) { text_ += " " + std::to_string(value); }
  void write(std::uint64_t value) { text_ += " " + std::to_string(value); }
  void write(bool value) { text_ += value ? " true" : " false"; }
  void write(const std::string& value);
  void write(const Fraction& value);
  void write(const Vec2& v) { text_ += " [" + number_text(v.x) + ", " + number_text(v.y) + "]"; }
  template <class E>
    requires std::is_enum_v<E>
  void write(E value) {
    text_ += std::string(" ") + enum_names(E{})[static_cast<std::size_t>(value)];
  }
  template <Struct T>
  void write(T& value) {
    indent_ += 2;
    visit(*this, value);
    indent_ -= 2;
  }
  template <class T>
  void write(std::vector<T>& list) {
    if (list.empty()) text_ += " []";
    for (T& item : list) {
      if constexpr (Struct<T>) {
        FieldWriter part(canonical_);
        part.path_ = path_;
        visit(part, item);
        append_entry(part.text());
      } else {
        text_ += "\n" + std::string(indent_ + 2, ' ') + "-";
        write(item);
      }
    }
  }
  template <Map T>
  void write(T& map) {
    if (map.empty()) text_ += " {}";
    indent_ += 2;
    for (auto& [key, value] : map) entry(key, value, &FieldWriter::quoted_key);
    indent_ -= 2;
  }
  void append_entry(const std::string& entry);

  CanonicalKeys canonical_;  ///< if empty, keys are written by their current names
  std::string path_;  ///< dotted path of the current key from the top level, with a leading dot
  std::string text_;
  std::size_t indent_ = 0;
};

/// @throws ConfigError if a renamed key has its canonical name instead of its current name
void check_current_names(const Tree& tree, const CanonicalKeys& canonical,
                         const std::string& path = "");

/// Replaces canonical names of keys by their current names.
/// @throws ConfigError if a map has a key under both names
Tree with_current_names(Tree tree, const CanonicalKeys& canonical, const std::string& path = "");

/// Returns the configuration in a user's file, in which keys must have their current names.
template <class T>
T read_struct(const Tree& tree, const CanonicalKeys& canonical = kCanonicalKeys) {
  check_current_names(tree, canonical);
  T value;
  FieldReader reader(tree, "");
  visit(reader, value);
  reader.finish();
  return value;
}

/// Like read_struct, for a file that a run wrote. In files of version 0.3, keys have their
/// canonical names.
template <class T>
T read_written(const Tree& tree, const CanonicalKeys& canonical = kCanonicalKeys) {
  return read_struct<T>(with_current_names(tree, canonical), canonical);
}

/// Returns every key of a struct with its value, as YAML.
template <class T>
std::string dump_struct(T value) {
  FieldWriter writer;
  visit(writer, value);
  return writer.text() + "\n";
}

/// Like dump_struct, but with canonical names of keys. The text identifies data folders and rows of
/// results.
template <class T>
std::string canonical_text(T value, const CanonicalKeys& canonical = kCanonicalKeys) {
  FieldWriter writer(canonical);
  visit(writer, value);
  return writer.text() + "\n";
}

}  // namespace infrasim::config
