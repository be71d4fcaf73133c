#include "infrasim/io/npy.h"

#include <algorithm>
#include <bit>
#include <cstring>
#include <optional>
#include <string>
#include <string_view>

#include "infrasim/core/errors.h"
#include "infrasim/core/files.h"
#include "infrasim/core/numbers.h"
#include "infrasim/io/atomic_file.h"

namespace infrasim {

static_assert(std::endian::native == std::endian::little, "the files are little-endian");

namespace {

constexpr std::string_view kNpyMagic = "\x93NUMPY";

/// The parts of a .npy file, as views of the file's bytes.
struct NpyFile {
  std::string_view header;  ///< {'descr': '<f8', 'fortran_order': False, 'shape': (2, 2), }
  std::string_view data;
};

/// Splits a file in the format of NumPy enhancement proposal 1. Returns no value if the bytes are
/// not in this format.
std::optional<NpyFile> split_npy(std::string_view bytes) {
  if (!bytes.starts_with(kNpyMagic) || bytes.size() < 12) return std::nullopt;
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(bytes[i]); };
  const unsigned version = byte(6);
  if (version < 1 || version > 3) return std::nullopt;
  const std::size_t start = version == 1 ? 10 : 12;
  std::size_t length = byte(8) + 256U * byte(9);
  if (version > 1) length += 65536U * byte(10) + 16777216U * byte(11);
  if (length > bytes.size() - start) return std::nullopt;
  return NpyFile{bytes.substr(start, length), bytes.substr(start + length)};
}

/// Returns the value of a header entry such as `'descr': '<f4'`, up to the next comma or bracket.
std::string_view entry(std::string_view header, const std::string& name) {
  const auto at = header.find("'" + name + "': ");
  if (at == header.npos) return {};
  const std::string_view rest = header.substr(at + name.size() + 4);
  const bool tuple = rest.starts_with('(');
  const auto end = std::min(rest.find(tuple ? ')' : ','), rest.size());
  return rest.substr(0, end + (tuple ? 1 : 0));
}

/// Returns the number of rows n from the text of a shape (n, columns).
std::optional<std::size_t> rows_of(std::string_view shape, std::size_t columns) {
  const std::string tail = ", " + std::to_string(columns) + ")";
  if (!shape.starts_with('(') || !shape.ends_with(tail)) return std::nullopt;
  return parse_number<std::size_t>(shape.substr(1, shape.size() - 1 - tail.size()));
}

template <class T>
std::vector<double> values_of(std::string_view data) {
  std::vector<double> values(data.size() / sizeof(T));
  for (std::size_t i = 0; i < values.size(); ++i) {
    T value;
    std::memcpy(&value, data.data() + i * sizeof(T), sizeof(T));
    values[i] = value;
  }
  return values;
}

}  // namespace

void write_npy(const std::filesystem::path& file, std::span<const double> values,
               std::size_t columns) {
  std::string header = "{'descr': '<f8', 'fortran_order': False, 'shape': (" +
                       std::to_string(values.size() / columns) + ", " + std::to_string(columns) +
                       "), }";
  header.append(63 - (10 + header.size()) % 64, ' ');
  header += '\n';
  std::string bytes = std::string(kNpyMagic) + '\x01' + '\x00';
  bytes += static_cast<char>(header.size() % 256);
  bytes += static_cast<char>(header.size() / 256);
  bytes += header;
  const std::size_t start = bytes.size();
  bytes.resize(start + values.size_bytes());
  std::memcpy(bytes.data() + start, values.data(), values.size_bytes());
  write_file_atomically(file, bytes);
}

NpyTable read_npy(const std::filesystem::path& file, std::size_t least, std::size_t most) {
  const std::string bytes = read_file(file);
  const auto reject = [&](const std::string& problem) {
    throw ConfigError(file.string() + ":1:1: (npy): expected a C-ordered (n, " +
                      std::to_string(least) + (most > least ? " to " + std::to_string(most) : "") +
                      ") array of <f4 or <f8, got " + problem);
  };
  const auto npy = split_npy(bytes);
  if (!npy) reject("a file without a complete NumPy header of version 1 to 3");
  const std::string_view type = entry(npy->header, "descr"), shape = entry(npy->header, "shape");
  const std::string shown(shape.substr(0, 80));
  if (type != "'<f4'" && type != "'<f8'") reject("type " + std::string(type.substr(0, 80)));
  if (entry(npy->header, "fortran_order") != "False") reject("Fortran order");
  std::optional<std::size_t> rows;
  std::size_t columns = least;
  for (std::size_t n = least; n <= most && !rows; ++n) {
    rows = rows_of(shape, n);
    columns = n;
  }
  if (!rows) reject("shape " + shown);
  const std::size_t row_bytes = columns * (type == "'<f4'" ? 4 : 8);
  if (npy->data.size() % row_bytes != 0 || npy->data.size() / row_bytes != *rows)
    reject("shape " + shown + ", which does not match the size of the data, " +
           std::to_string(npy->data.size()) + " bytes");
  return {type == "'<f4'" ? values_of<float>(npy->data) : values_of<double>(npy->data), columns};
}

}  // namespace infrasim
