#include "infrasim/io/ply_file.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <optional>
#include <string>
#include <string_view>

#include "infrasim/core/errors.h"
#include "infrasim/core/files.h"
#include "infrasim/core/numbers.h"

namespace infrasim {

namespace {

/// A scalar type and the two names that files use for it.
struct PlyType {
  std::string_view name, other_name;
  std::size_t bytes;
  bool whole;
  double (*read)(const char* at);
};

template <class T>
double ply_value(const char* at) {
  T value;
  std::memcpy(&value, at, sizeof(T));
  return static_cast<double>(value);
}

constexpr std::array kPlyTypes{
    PlyType{"char", "int8", 1, true, ply_value<std::int8_t>},
    PlyType{"uchar", "uint8", 1, true, ply_value<std::uint8_t>},
    PlyType{"short", "int16", 2, true, ply_value<std::int16_t>},
    PlyType{"ushort", "uint16", 2, true, ply_value<std::uint16_t>},
    PlyType{"int", "int32", 4, true, ply_value<std::int32_t>},
    PlyType{"uint", "uint32", 4, true, ply_value<std::uint32_t>},
    PlyType{"float", "float32", 4, false, ply_value<float>},
    PlyType{"double", "float64", 8, false, ply_value<double>},
};

struct PlyProperty {
  std::string name;
  const PlyType* type = nullptr;
  const PlyType* count = nullptr;  ///< type of a list's length; null for a single value
};

struct PlyElement {
  std::string name;
  std::size_t count = 0;
  std::vector<PlyProperty> properties;

  const PlyProperty* find(std::string_view wanted) const {
    const auto entry = std::ranges::find(properties, wanted, &PlyProperty::name);
    return entry == properties.end() ? nullptr : &*entry;
  }
};

class PlyReader {
 public:
  explicit PlyReader(const std::filesystem::path& file)
      : name_(file.string()), text_(read_file(file)) {}

  PlySurface read() {
    read_header();
    for (const PlyElement& element : elements_) {
      check_size(element);
      for (std::size_t i = 0; i < element.count; ++i) read_row(element);
    }
    if (ascii_) skip_blanks();
    if (at_ != text_.size()) fail("expected the end of the file, got bytes after the last element");
    if (out_.vertices.empty() || out_.triangles.empty())
      fail("expected vertices and faces, got no vertices or no faces");
    return std::move(out_);
  }

 private:
  [[noreturn]] void fail(const std::string& what) const {
    const bool by_line = in_header_ || ascii_;
    const auto line =
        1 + std::count(text_.begin(), text_.begin() + static_cast<std::ptrdiff_t>(at_), '\n');
    throw ConfigError(name_ + (by_line ? ":" + std::to_string(line) : "") + ": " +
                      (by_line ? "" : "byte " + std::to_string(at_) + ": ") + what);
  }

  // --- header -----------------------------------------------------------------------------------

  /// Returns the words of the next line.
  std::vector<std::string_view> words() {
    const std::size_t end = text_.find('\n', at_);
    if (end == std::string::npos) fail("expected a .ply, got the end of the file in its header");
    std::string_view line = std::string_view(text_).substr(at_, end - at_);
    std::vector<std::string_view> out;
    while (!line.empty()) {
      const std::size_t stop = std::min(line.find_first_of(" \t\r"), line.size());
      if (stop > 0) out.push_back(line.substr(0, stop));
      line.remove_prefix(std::min(stop + 1, line.size()));
    }
    next_ = end + 1;
    return out;
  }

  void read_header() {
    if (words() != std::vector<std::string_view>{"ply"})
      fail("expected 'ply' in the first line, got other text");
    bool format = false;
    for (at_ = next_;; at_ = next_) {
      const auto line = words();
      if (line.empty() || line[0] == "comment" || line[0] == "obj_info") continue;
      if (line[0] == "end_header") break;
      if (line[0] == "format" && line.size() == 3) {
        format = true;
        ascii_ = line[1] == "ascii";
        if (!ascii_ && line[1] != "binary_little_endian")
          fail("expected ascii, binary_little_endian, got format " + std::string(line[1]));
      } else if (line[0] == "element" && line.size() == 3) {
        const auto count = parse_number<std::uint64_t>(line[2]);
        if (!count) fail("expected a number as the count, got a word");
        if (std::ranges::count(elements_, line[1], &PlyElement::name) > 0)
          fail("expected each element once, got '" + std::string(line[1].substr(0, 40)) +
               "' twice");
        elements_.push_back({std::string(line[1]), *count, {}});
      } else if (line[0] == "property" && !elements_.empty()) {
        add_property(elements_.back(), line);
      } else {
        fail("expected format, element, property, comment, end_header, got '" +
             std::string(line[0].substr(0, 40)) + "'");
      }
    }
    if (!format) fail("expected ascii, binary_little_endian, got no format");
    at_ = next_;
    in_header_ = false;
  }

  void add_property(PlyElement& element, const std::vector<std::string_view>& line) const {
    PlyProperty added = property(line);
    const bool place = added.name == "x" || added.name == "y" || added.name == "z";
    if (element.find(added.name) != nullptr)
      fail("expected each property once, got '" + added.name.substr(0, 40) + "' twice");
    if (element.name == "vertex" && place && (added.type->whole || added.count != nullptr))
      fail("expected float or double, got " + added.name + " of another type");
    if (added.count != nullptr && !added.count->whole)
      fail("expected whole numbers, got a list whose length is of type " +
           std::string(added.count->name));
    if (element.name == "face" && is_corners(added) && !added.type->whole)
      fail("expected whole numbers, got corners of type " + std::string(added.type->name));
    element.properties.push_back(std::move(added));
  }

  static bool is_corners(const PlyProperty& p) {
    return p.count != nullptr && (p.name == "vertex_indices" || p.name == "vertex_index");
  }

  PlyProperty property(const std::vector<std::string_view>& line) const {
    if (line.size() == 3) return {std::string(line[2]), type(line[1]), nullptr};
    if (line.size() == 5 && line[1] == "list")
      return {std::string(line[4]), type(line[3]), type(line[2])};
    fail(
        "expected 'property TYPE NAME', 'property list TYPE TYPE NAME', got a "
        "property of " +
        std::to_string(line.size()) + " words");
  }

  const PlyType* type(std::string_view name) const {
    const auto* entry = std::ranges::find_if(
        kPlyTypes, [&](const PlyType& t) { return t.name == name || t.other_name == name; });
    if (entry == kPlyTypes.end())
      fail("expected char to double, int8 to float64, got type '" +
           std::string(name.substr(0, 40)) + "'");
    return entry;
  }

  /// Checks the element count against the file's size before memory is reserved.
  void check_size(const PlyElement& element) {
    std::size_t least = 0;
    for (const PlyProperty& p : element.properties)
      least += ascii_ ? 2 : (p.count != nullptr ? p.count->bytes : p.type->bytes);
    if (least == 0) fail("expected properties of element '" + element.name + "', got none");
    const std::size_t left = text_.size() - at_ + (ascii_ ? 1 : 0);
    if (element.count > left / least)
      fail("expected rows that fit the size of the file, got " + std::to_string(element.count) +
           " of '" + element.name + "' in " + std::to_string(left) +
           " bytes; the file may be truncated");
    if (element.count > kMostTriangles)
      fail("expected up to " + std::to_string(kMostTriangles) + " elements, got " +
           std::to_string(element.count) + " of '" + element.name + "'");
    if (element.name == "vertex") out_.vertices.reserve(element.count);
    if (element.name == "face") out_.triangles.reserve(element.count);
  }

  // --- rows -------------------------------------------------------------------------------------

  void read_row(const PlyElement& element) {
    Vec3 vertex{kInf, kInf, kInf};
    bool corners = false;
    for (const PlyProperty& p : element.properties) {
      const auto n = p.count != nullptr ? items(value(*p.count)) : std::size_t{1};
      if (element.name == "face" && is_corners(p)) {
        add_face(n, *p.type);
        corners = true;
        continue;
      }
      for (std::size_t i = 0; i < n; ++i) {
        const double v = value(*p.type);
        if (p.name == "x") vertex.x = v;
        if (p.name == "y") vertex.y = v;
        if (p.name == "z") vertex.z = v;
      }
    }
    if (element.name == "vertex") add_vertex(vertex);
    if (element.name == "face" && !corners)
      fail("expected faces with vertex_indices, got a face without them");
  }

  void add_vertex(Vec3 v) {
    const double largest = std::max({std::abs(v.x), std::abs(v.y), std::abs(v.z)});
    if (!(largest <= kFarthestVertex_m) || std::isnan(v.x + v.y + v.z))
      fail(
          "expected metres from the site's origin, got a vertex whose x, y or z is missing, "
          "not a number, or farther than " +
          std::to_string(static_cast<int>(kFarthestVertex_m)) + " m from the origin");
    out_.vertices.push_back(v);
  }

  void add_face(std::size_t n, const PlyType& type) {
    if (n < 3) fail("expected 3 or more corners, got a face of " + std::to_string(n) + " corners");
    const std::uint32_t first = corner(type);
    std::uint32_t before = corner(type);
    for (std::size_t i = 2; i < n; ++i) {
      const std::uint32_t here = corner(type);
      out_.triangles.push_back({first, before, here});
      before = here;
    }
    if (out_.triangles.size() > kMostTriangles)
      fail("expected at most " + std::to_string(kMostTriangles) + " triangles, got more");
  }

  std::uint32_t corner(const PlyType& type) {
    const double v = value(type);
    if (!(v >= 0 && v < static_cast<double>(out_.vertices.size())) || v != std::floor(v))
      fail("expected corners that are indices of the " + std::to_string(out_.vertices.size()) +
           " vertices before the face, counted from 0, got another number");
    return static_cast<std::uint32_t>(v);
  }

  std::size_t items(double count) const {
    if (!(count >= 0 && count <= 1e6) || count != std::floor(count))
      fail("expected a list length of 0 to 1000000, got another length");
    return static_cast<std::size_t>(count);
  }

  double value(const PlyType& type) {
    if (ascii_) return ascii_value();
    if (text_.size() - at_ < type.bytes)
      fail("expected more data, got the end of the file; the file may be truncated");
    const double v = type.read(text_.data() + at_);
    at_ += type.bytes;
    return v;
  }

  double ascii_value() {
    skip_blanks();
    const std::size_t end = std::min(text_.find_first_of(" \t\r\n", at_), text_.size());
    if (end == at_) fail("expected more data, got the end of the file; the file may be truncated");
    const auto v = parse_number<double>(std::string_view(text_).substr(at_, end - at_));
    if (!v)
      fail("expected a number, got '" + text_.substr(at_, std::min<std::size_t>(end - at_, 40)) +
           "'");
    at_ = end;
    return *v;
  }

  void skip_blanks() { at_ = std::min(text_.find_first_not_of(" \t\r\n", at_), text_.size()); }

  std::string name_;
  std::string text_;
  std::size_t at_ = 0;    ///< position of the next byte
  std::size_t next_ = 0;  ///< position of the next header line
  bool in_header_ = true;
  bool ascii_ = false;
  std::vector<PlyElement> elements_;
  PlySurface out_;
};

}  // namespace

PlySurface read_ply(const std::filesystem::path& file) { return PlyReader(file).read(); }

}  // namespace infrasim
