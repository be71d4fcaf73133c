// Reads PCD files, version 0.7 (Point Cloud Library's file format page).

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <sstream>

#include "infrasim/core/errors.h"
#include "infrasim/core/math.h"
#include "infrasim/core/numbers.h"
#include "infrasim/io/cloud_file.h"
#include "infrasim/io/lzf.h"

namespace infrasim {

namespace {

constexpr std::size_t kMaxFields = 256;
constexpr std::size_t kMaxCount = 65536;
constexpr std::size_t kMaxPoints = std::size_t{1} << 40;

/// Reads a PCD file line by line and reports errors with their position.
class PcdReader {
 public:
  PcdReader(std::string_view bytes, std::string name) : rest_(bytes), name_(std::move(name)) {}

  CloudFile read() {
    while (!data_seen_) header_line();
    check_header();
    if (data_ == "ascii")
      read_ascii();
    else if (data_ == "binary")
      read_binary();
    else
      read_compressed();
    return std::move(cloud_);
  }

 private:
  [[noreturn]] void fail(const std::string& key, const std::string& what) const {
    throw ConfigError(name_ + ":" + std::to_string(line_) + ":1: " + key + ": " + what);
  }

  std::string_view next_line() {
    if (rest_.empty()) fail("(end)", "expected a PCD header and data, got the end of the file");
    const auto end = std::min(rest_.find('\n'), rest_.size());
    std::string_view text = rest_.substr(0, end);
    rest_.remove_prefix(std::min(end + 1, rest_.size()));
    ++line_;
    if (text.ends_with('\r')) text.remove_suffix(1);
    return text;
  }

  static std::vector<std::string> words(std::string_view text) {
    std::istringstream in{std::string(text)};
    std::vector<std::string> out;
    for (std::string word; in >> word;) out.push_back(word);
    return out;
  }

  std::size_t whole(const std::string& key, const std::string& word, std::size_t max) const {
    const auto value = parse_number<std::size_t>(word);
    if (!value || *value > max)
      fail(key, "expected a whole number up to " + std::to_string(max) + ", got '" +
                    word.substr(0, 40) + "'");
    return *value;
  }

  void header_line() {
    const std::string_view text = next_line();
    if (text.empty() || text.front() == '#') return;
    std::vector<std::string> w = words(text.substr(0, 65536));
    if (w.empty()) return;
    const std::string key = w.front();
    w.erase(w.begin());
    if (std::ranges::count(keys_, key) > 0)
      fail(key.substr(0, 40), "expected the key once, got it twice");
    keys_.push_back(key);
    if (key == "FIELDS") return read_fields(w);
    if (key == "SIZE" || key == "TYPE" || key == "COUNT") return read_columns(key, w);
    if (key == "VIEWPOINT") return read_viewpoint(w);
    if (w.size() != 1) fail(key, "expected 1 value, got " + std::to_string(w.size()));
    if (key == "VERSION") {
      if (w[0] != "0.7" && w[0] != ".7") fail(key, "expected 0.7, got '" + w[0] + "'");
    } else if (key == "WIDTH") {
      width_ = whole(key, w[0], kMaxPoints);
    } else if (key == "HEIGHT") {
      height_ = whole(key, w[0], kMaxPoints);
    } else if (key == "POINTS") {
      cloud_.points = whole(key, w[0], kMaxPoints);
      points_seen_ = true;
    } else if (key == "DATA") {
      read_data_kind(w[0]);
    } else {
      fail(key.substr(0, 40),
           "expected VERSION, FIELDS, SIZE, TYPE, COUNT, WIDTH, HEIGHT, VIEWPOINT, "
           "POINTS, DATA, got an unknown key");
    }
  }

  void read_viewpoint(const std::vector<std::string>& values) {
    const std::string key = "VIEWPOINT";
    if (values.size() != 7) fail(key, "expected 7 values, got " + std::to_string(values.size()));
    cloud_.viewpoint.clear();
    double length = 0;
    for (std::size_t i = 0; i < values.size(); ++i) {
      const double value = number<double>(key, values[i], "a number");
      if (!std::isfinite(value)) fail(key, "expected finite numbers, got '" + values[i] + "'");
      if (i >= 3) length = math::hypot(length, value);
      cloud_.viewpoint += (i == 0 ? "" : " ") + values[i];
    }
    // Programs that do not support a rotation write a quaternion of zeros.
    if (length != 0 && (length < 0.9 || length > 1.1))
      fail(key, "expected a quaternion of length 1, got " + fixed_text(length, 6));
  }

  void read_data_kind(const std::string& kind) {
    if (kind != "ascii" && kind != "binary" && kind != "binary_compressed")
      fail("DATA", "expected ascii, binary, binary_compressed, got '" + kind.substr(0, 40) + "'");
    data_ = kind;
    data_seen_ = true;
    cloud_.encoding = kind == "ascii"    ? PcdEncoding::kAscii
                      : kind == "binary" ? PcdEncoding::kBinary
                                         : PcdEncoding::kBinaryCompressed;
  }

  void read_fields(const std::vector<std::string>& names) {
    if (names.empty() || names.size() > kMaxFields || !cloud_.fields.empty())
      fail("FIELDS",
           "expected 1 to 256 names, once, got " + std::to_string(names.size()) + " names");
    for (const std::string& name : names) cloud_.fields.push_back({name});
  }

  void read_columns(const std::string& key, const std::vector<std::string>& values) {
    if (values.size() != cloud_.fields.size())
      fail(key, "expected one value per field (" + std::to_string(cloud_.fields.size()) +
                    "), got " + std::to_string(values.size()) + " values");
    for (std::size_t i = 0; i < values.size(); ++i) {
      CloudField& f = cloud_.fields[i];
      if (key == "TYPE") {
        if (values[i] != "F" && values[i] != "I" && values[i] != "U")
          fail(key, "expected F, I, U, got '" + values[i].substr(0, 40) + "'");
        f.type = values[i][0];
      } else if (key == "SIZE") {
        f.size = static_cast<int>(whole(key, values[i], 8));
      } else {
        f.count = static_cast<int>(whole(key, values[i], kMaxCount));
      }
    }
  }

  void check_header() const {
    for (const CloudField& f : cloud_.fields) {
      const bool valid =
          f.size == 8 || f.size == 4 || (f.type != 'F' && (f.size == 1 || f.size == 2));
      if (f.count < 1) fail("COUNT", "expected 1 or more, got 0 for field '" + f.name + "'");
      if (!valid)
        fail("SIZE", "expected F4 F8 I1 I2 I4 I8 U1 U2 U4 U8, got field '" + f.name + "' of type " +
                         f.type + " and size " + std::to_string(f.size));
    }
    for (const char* key : {"SIZE", "TYPE"})
      if (std::ranges::count(keys_, key) == 0) fail(key, "expected a value, got none");
    for (const char* name : {"x", "y", "z"})
      if (cloud_.field(name) == nullptr ||
          std::ranges::count(cloud_.fields, name, &CloudField::name) > 1)
        fail("FIELDS", std::string("expected one field ") + name + ", got none or several");
    if (!points_seen_) fail("POINTS", "expected a value, got none");
    const bool overflow = height_ != 0 && width_ > kMaxPoints / height_;
    if (overflow || width_ * height_ != cloud_.points)
      fail("POINTS", "expected WIDTH x HEIGHT = " + std::to_string(width_) + " x " +
                         std::to_string(height_) + ", got " + std::to_string(cloud_.points));
  }

  /// Returns the number of data bytes that the header declares. The number is compared with the
  /// size of the file before memory is allocated.
  std::size_t promised(std::size_t most) const {
    const std::size_t record = cloud_.record_size();
    if (cloud_.points > most / record)
      fail("POINTS", "expected points that fit the size of the file, got " +
                         std::to_string(cloud_.points) + " points of " + std::to_string(record) +
                         " bytes");
    return cloud_.points * record;
  }

  /// Throws an error if the file has more data than the header declares.
  void require_end(std::size_t size) const {
    if (rest_.size() > size)
      fail("POINTS", "expected data of the size in the header, got " +
                         std::to_string(rest_.size() - size) + " bytes more");
  }

  void read_binary() {
    const std::size_t size = promised(rest_.size());
    require_end(size);
    cloud_.records = rest_.substr(0, size);
  }

  void read_compressed() {
    std::uint32_t sizes[2] = {};
    if (rest_.size() < sizeof(sizes))
      fail("DATA", "expected two sizes of type uint32, got the end of the file");
    std::memcpy(sizes, rest_.data(), sizeof(sizes));
    rest_.remove_prefix(sizeof(sizes));
    constexpr std::size_t kBestRatio = 264;
    if (sizes[0] > rest_.size() || sizes[1] > sizes[0] * kBestRatio)
      fail("DATA", "expected sizes that fit the size of the file, got sizes " +
                       std::to_string(sizes[0]) + " and " + std::to_string(sizes[1]));
    const std::size_t size = promised(sizes[1]);
    if (size != sizes[1])
      fail("DATA", "expected " + std::to_string(size) + " bytes, got " + std::to_string(sizes[1]) +
                       " bytes");
    require_end(sizes[0]);
    const auto columns = lzf_decompress(rest_, size);
    if (!columns)
      fail("DATA", "expected LZF data of the stated size, got invalid data or another size");
    cloud_.records.resize(size);
    transpose(*columns, cloud_.records);
  }

  /// Converts compressed data, which is stored field by field, to records, which are stored point
  /// by point.
  void transpose(const std::string& columns, std::string& records) const {
    const std::size_t stride = cloud_.record_size();
    std::size_t offset = 0, from = 0;
    for (const CloudField& f : cloud_.fields) {
      const std::size_t width = static_cast<std::size_t>(f.size) * f.count;
      for (std::size_t i = 0; i < cloud_.points; ++i, from += width)
        std::memcpy(&records[i * stride + offset], &columns[from], width);
      offset += width;
    }
  }

  void read_ascii() {
    promised(rest_.size() * 8);  // the shortest text of a value, "0 ", can stand for 8 bytes
    cloud_.records.reserve(cloud_.points * cloud_.record_size());
    for (std::size_t i = 0; i < cloud_.points; ++i) {
      const std::vector<std::string> values = words(next_line());
      std::size_t k = 0;
      for (const CloudField& f : cloud_.fields)
        for (int j = 0; j < f.count; ++j, ++k) {
          if (k >= values.size())
            fail(f.name, "expected a value for each field of a row, got too few");
          append_value(f, values[k]);
        }
      if (k != values.size())
        fail("(row)", "expected a value for each field of a row, got too many");
    }
    if (rest_.find_first_not_of(" \t\r\n") != rest_.npos) require_end(0);
  }

  template <class T>
  T number(const std::string& key, const std::string& word, const std::string& allowed) const {
    const auto value = parse_number<T>(word);
    if (!value) fail(key, "expected " + allowed + ", got '" + word.substr(0, 40) + "'");
    return *value;
  }

  void append_value(const CloudField& field, const std::string& word) {
    const std::string type = field.type + std::to_string(8 * field.size);
    with_type(field, [&]<class T>(T value) {
      value = number<T>(field.name, word, "a number of type " + type);
      cloud_.records.append(reinterpret_cast<const char*>(&value), sizeof(T));
    });
  }

  std::string_view rest_;
  std::string name_;
  int line_ = 0;
  CloudFile cloud_;
  std::vector<std::string> keys_;
  std::string data_;
  bool data_seen_ = false;
  bool points_seen_ = false;
  std::size_t width_ = 0;
  std::size_t height_ = 1;
};

}  // namespace

CloudFile parse_pcd(std::string_view bytes, const std::string& name) {
  return PcdReader(bytes, name).read();
}

}  // namespace infrasim
