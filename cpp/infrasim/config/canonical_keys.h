#pragma once

#include <array>
#include <span>
#include <string_view>

// The identity of a folder or of a row of results is computed from configuration keys. It uses the
// canonical names of the keys, which are the names of version 0.3. Folders and rows of older
// versions therefore stay valid when a key is renamed, or when a key with a default is added. This
// header lists all changes since version 0.3.

namespace infrasim::config {

/// A key that was renamed after version 0.3. The canonical name is accepted only in the files of
/// data folders.
struct RenamedKey {
  /// The end of the key's dotted path, such as `spinning.cut_angle_deg` or `mounts.*.x_m`. A *
  /// matches any name. A path with a leading dot begins at the top level. List indices are omitted.
  std::string_view path;
  std::string_view canonical;
};

/// A key that was added after version 0.3. While it has its default value, it is not part of the
/// identity.
struct LaterKey {
  std::string_view path;      ///< end of the key's dotted path, as in RenamedKey
  std::string_view standard;  ///< the key's default, as `infrasim check` prints it
};

struct CanonicalKeys {
  std::span<const RenamedKey> renamed;
  std::span<const LaterKey> later;
};

inline constexpr std::array kRenamedKeys{
    RenamedKey{"spinning.cut_angle_deg", "seam_deg"}, RenamedKey{"pattern.prisms", "wedges"},
    RenamedKey{"prisms.prisms", "wedges"}, RenamedKey{"mounts.*.own_random_stream", "own_draws"}};
inline constexpr std::array kLaterKeys{
    LaterKey{"channels.table.column_step", "1"}, LaterKey{"channels.table.first_column", "0"},
    LaterKey{"prisms.period_s", "0.1"}, LaterKey{"table.period_s", "0.1"}};
inline constexpr CanonicalKeys kCanonicalKeys{kRenamedKeys, kLaterKeys};

/// Returns whether a path, such as `.pattern.spinning.cut_angle_deg`, ends with a pattern in which
/// * matches any name.
bool ends_as(std::string_view path, std::string_view pattern);

}  // namespace infrasim::config
