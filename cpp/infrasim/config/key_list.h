#pragma once

#include <optional>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "infrasim/config/fields.h"

namespace infrasim::config {

/// Lists the keys of a struct with tabs between the columns, one line per key: path, type, default,
/// allowed values, meaning. N stands for a list index and NAME for a map key.
class FieldLister {
 public:
  template <class T>
  void field(const char* key, T& value, const char* doc, Rule rule = {}) {
    const std::string path = path_ + key;
    text_ += path + '\t' + type(value) + '\t' + (rule.required ? "required" : standard(value)) +
             '\t' + allowed(value, rule) + '\t' + doc + '\n';
    inside(value, path);
  }
  void here(const Place&) const {}
  void here(const KeyPlace&, const char*) const {}
  void check(bool, const char*, const std::string&) const {}

  const std::string& text() const { return text_; }

 private:
  static std::string type(double) { return "number"; }
  static std::string type(int) { return "whole number"; }
  static std::string type(std::uint64_t) { return "whole number"; }
  static std::string type(bool) { return "true or false"; }
  static std::string type(const std::string&) { return "text"; }
  static std::string type(const Vec2&) { return "pair"; }
  static std::string type(const Fraction&) { return "whole number or fraction"; }
  template <class E>
    requires std::is_enum_v<E>
  static std::string type(E) {
    return "word";
  }
  template <Struct T>
  static std::string type(const T&) {
    return "section";
  }
  template <class T>
  static std::string type(const std::optional<T>&) {
    return type(T{});
  }
  template <class T>
  static std::string type(const std::vector<T>&) {
    return "list of " + type(T{}) + "s";
  }
  template <Map T>
  static std::string type(const T&) {
    return type(typename T::mapped_type{}) + "s by name";
  }

  /// Returns the default of a number, a word or a text, as `dump_struct` writes it. Returns an
  /// empty text for values of other types.
  template <class T>
  static std::string standard(T& value) {
    if constexpr (std::is_arithmetic_v<T> || std::is_enum_v<T> || std::is_same_v<T, std::string>) {
      FieldWriter writer;
      writer.field("", value, "");
      return writer.text().substr(2);  // the text after ": "
    } else {
      return "";
    }
  }

  template <class T>
  static std::string allowed(const T&, const Rule& rule) {
    if constexpr (std::is_enum_v<T>) {
      return listed(enum_names(T{}));
    } else if constexpr (std::is_same_v<T, std::uint64_t>) {
      return "from 0";
    } else {
      return range(rule);
    }
  }
  template <class T>
  static std::string allowed(const std::optional<T>&, const Rule& rule) {
    return allowed(T{}, rule);
  }
  static std::string range(const Rule& rule) {
    constexpr double kUnbounded = Rule{}.max;
    const bool low = rule.min > -kUnbounded, high = rule.max < kUnbounded;
    const std::string from =
        low ? (rule.above_min ? "above " : "from ") + number_text(rule.min) : "";
    const std::string to = high ? "up to " + number_text(rule.max) : "";
    return from + (low && high ? " " : "") + to;
  }

  template <class T>
  void inside(const T&, const std::string& path) {
    if constexpr (Struct<T>) {
      T value;
      const std::string before = std::exchange(path_, path + ".");
      visit(*this, value);
      path_ = before;
    }
  }
  template <class T>
  void inside(const std::optional<T>&, const std::string& path) {
    inside(T{}, path);
  }
  template <class T>
  void inside(const std::vector<T>&, const std::string& path) {
    inside(T{}, path + ".N");
  }
  template <Map T>
  void inside(const T&, const std::string& path) {
    inside(typename T::mapped_type{}, path + ".NAME");
  }

  std::string path_;
  std::string text_;
};

template <class T>
std::string list_keys() {
  FieldLister lister;
  T value;
  visit(lister, value);
  return lister.text();
}

/// Returns a table of all keys of a scene file (first function) or of a LiDAR file (second
/// function). FieldLister describes its columns.
std::string list_scene_keys();
std::string list_lidar_keys();

}  // namespace infrasim::config
