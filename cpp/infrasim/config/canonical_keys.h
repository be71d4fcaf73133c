#pragma once

#include <array>
#include <span>
#include <string_view>

// The identity of a folder or of a row of results is computed from configuration keys. It uses the
// key names of version 0.3, the canonical names. So a key can be renamed, or a key with a default
// added, and old folders and rows stay valid. Only this header lists the changes since 0.3.

namespace infrasim::config {

/// A key that was renamed since version 0.3. The canonical name is accepted in the files of data
/// folders alone.
struct RenamedKey {
  /// The end of the key's dotted path, such as `spinning.cut_angle_deg` or `mounts.*.x_m`. A *
  /// stands for any name, and a leading dot for the top level. List indices are left out.
  std::string_view path;
  std::string_view canonical;
};

/// A key added after version 0.3. With its default value it is not part of the identity.
struct LaterKey {
  std::string_view path;      ///< as in RenamedKey
  std::string_view standard;  ///< its default, in the form that `infrasim check` prints
};

struct CanonicalKeys {
  std::span<const RenamedKey> renamed;
  std::span<const LaterKey> later;
};

inline constexpr std::array kRenamedKeys{RenamedKey{"spinning.cut_angle_deg", "seam_deg"},
                                         RenamedKey{"pattern.prisms", "wedges"},
                                         RenamedKey{"prisms.prisms", "wedges"}};
inline constexpr std::array<LaterKey, 0> kLaterKeys{};
inline constexpr CanonicalKeys kCanonicalKeys{kRenamedKeys, kLaterKeys};

/// Whether a path, such as `.pattern.spinning.cut_angle_deg`, ends with the pattern of a table
/// entry.
bool ends_as(std::string_view path, std::string_view pattern);

}  // namespace infrasim::config
