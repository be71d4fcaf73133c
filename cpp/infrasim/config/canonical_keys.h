#pragma once

#include <array>
#include <span>
#include <string_view>

// What a folder or a row of results is told by is made of the keys as version 0.3 named them, the
// canonical names, so that a key may get another name, or a default come to it, and old folders and
// rows stay what they are. Here, and nowhere else, is said what has changed since.

namespace infrasim::config {

/// A key that has another name than in version 0.3. Its canonical name is read as well.
struct RenamedKey {
  /// The end of its dotted path, such as `spinning.cut_angle_deg` or `mounts.*.x_m`, where * stands
  /// for any name; one at the top begins with a dot. Numbers of lists are left out.
  std::string_view path;
  std::string_view canonical;
};

/// A key that came after version 0.3: with its default it is no part of what a folder is told by.
struct LaterKey {
  std::string_view path;      ///< as of RenamedKey
  std::string_view standard;  ///< its default, as `infrasim check` prints it
};

struct CanonicalKeys {
  std::span<const RenamedKey> renamed;
  std::span<const LaterKey> later;
};

inline constexpr std::array<RenamedKey, 0> kRenamedKeys{};
inline constexpr std::array<LaterKey, 0> kLaterKeys{};
inline constexpr CanonicalKeys kCanonicalKeys{kRenamedKeys, kLaterKeys};

/// Whether a path, such as `.pattern.spinning.cut_angle_deg`, ends as the pattern of a table does.
bool ends_as(std::string_view path, std::string_view pattern);

}  // namespace infrasim::config
