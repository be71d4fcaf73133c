#include "infrasim/config/fields.h"

#include <array>
#include <cctype>
#include <numeric>

#include "infrasim/core/hints.h"
#include "infrasim/core/numbers.h"

namespace infrasim::config {

namespace {

std::string value_text(const Tree& tree) {
  switch (tree.kind) {
    case Tree::Kind::kNull:
      return "nothing";
    case Tree::Kind::kSequence:
      return "a list";
    case Tree::Kind::kMap:
      return "a map";
    case Tree::Kind::kScalar:
      break;
  }
  return "'" + tree.scalar.substr(0, 60) + "'";
}

std::string expected(const std::string& allowed, const Tree& tree) {
  return "expected " + allowed + ", got " + value_text(tree);
}

// Minimum difference between a value and a lower limit that is not allowed itself. Values closer to
// the limit are probably typing errors, and their squares or inverses could overflow.
constexpr double kLeastAbove = 1e-9;

std::string allowed(const Rule& rule) {
  const std::string low = number_text(rule.min);
  return std::string(rule.above_min ? "above " + low : low) + " to " + number_text(rule.max);
}

bool parse_double(const std::string& text, double& value) {
  if (text == ".inf") {
    value = kInf;
    return true;
  }
  const bool plus = text.starts_with('+') && !text.starts_with("+-");
  const auto number = parse_number<double>(std::string_view(text).substr(plus ? 1 : 0));
  value = number.value_or(kInf);
  return std::isfinite(value);
}

/// Returns the current name of a key that is given by its canonical name, which is that of version
/// 0.3; no value for any other key.
std::optional<std::string> current_name(const std::string& key, const std::string& path,
                                        const CanonicalKeys& canonical) {
  for (const RenamedKey& renamed : canonical.renamed) {
    if (key != renamed.canonical) continue;
    const std::string_view now = renamed.path.substr(renamed.path.rfind('.') + 1);
    std::string current = path;
    current.append(".").append(now);
    if (ends_as(current, renamed.path)) return std::string(now);
  }
  return std::nullopt;
}

std::string quoted(const std::string& text) {
  std::string out = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') out += '\\';
    out += c;
  }
  return out + '"';
}

/// Returns whether a reader of YAML 1.1 would read a word as a boolean or as null.
bool is_yaml_word(std::string word) {
  constexpr std::array<std::string_view, 10> kWords{"y",   "n",    "yes",   "no",   "on",
                                                    "off", "true", "false", "null", "~"};
  for (char& c : word) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return std::ranges::find(kWords, std::string_view(word)) != kWords.end();
}

/// Returns whether a name can be written without quotes. Such a name begins with a letter, so YAML
/// readers do not read it as a number.
bool plain(const std::string& name) {
  const auto letter = [](char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z'); };
  return !name.empty() && letter(name.front()) && std::ranges::all_of(name, [&](char c) {
    return letter(c) || (c >= '0' && c <= '9') || c == '_';
  }) && !is_yaml_word(name);
}

}  // namespace

std::string quoted_name(const std::string& name) { return plain(name) ? name : quoted(name); }

std::string number_text(double value) {
  if (std::isinf(value)) return value > 0 ? ".inf" : "-.inf";
  // YAML 1.1 readers read 1e5 as a string. Therefore an exponent is written only if necessary, and
  // always with a decimal point.
  const double size = std::abs(value);
  const bool fixed = value == 0 || (size >= 1e-6 && size < 1e15);
  std::array<char, 64> buffer{};
  const auto end = std::to_chars(buffer.data(), buffer.data() + buffer.size(), value,
                                 fixed ? std::chars_format::fixed : std::chars_format::scientific)
                       .ptr;
  std::string text(buffer.data(), end);
  const auto exponent = text.find('e');
  if (exponent != std::string::npos && text.find('.') == std::string::npos)
    text.insert(exponent, ".0");
  return text;
}

bool begins_as_name(const std::string& text) {
  const unsigned char first = text.empty() ? 0 : static_cast<unsigned char>(text.front());
  // In UTF-8, letters beyond ASCII begin with a byte of 0x80 or more.
  return std::isalnum(first) != 0 || first == '_' || first >= 0x80;
}

void expect_map(const Tree& tree, const std::string& key) {
  if (tree.kind != Tree::Kind::kMap) fail(tree.place, key, expected("a map", tree));
}

std::optional<Tree> take_presets(Tree& tree) {
  std::optional<Tree> presets = take(tree, "presets");
  if (presets) expect_map(*presets, "presets");
  return presets;
}

const Tree* FieldReader::take(const char* key, const Rule& rule) {
  taken_.emplace_back(key);
  const Tree* tree = map_.find(key);
  if (tree == nullptr && rule.required) check(false, key, "expected a value, got none");
  return tree;
}

void FieldReader::finish() const {
  if (map_.kind != Tree::Kind::kMap) {
    constexpr std::size_t kMostKeys = 10;  // a longer list is no help
    const std::string keys = taken_.size() > kMostKeys ? "" : " with the keys " + listed(taken_);
    fail(map_.place, path_.empty() ? "(document)" : path_, expected("a map" + keys, map_));
  }
  refuse_commas(map_, path_);
  for (std::size_t i = 0; i < map_.keys.size(); ++i) {
    const std::string& key = map_.keys[i];
    if (std::ranges::find(taken_, key) != taken_.end()) continue;
    fail(map_.items[i].place, full(key.c_str()),
         "expected " + listed(taken_) + ", got an unknown key" + suggestion(key, taken_));
  }
  if (!failed_check_) return;
  const auto& [key, what] = *failed_check_;
  const Tree* tree = map_.find(key);
  fail(tree != nullptr ? tree->place : map_.place, full(key), what);
}

void FieldReader::check(bool holds, const char* key, const std::string& what) {
  if (!holds && !failed_check_) failed_check_.emplace(key, what);
}

void FieldReader::expect(const Tree& tree, Tree::Kind kind, const std::string& key,
                         const std::string& what) {
  if (tree.kind != kind) fail(tree.place, key, expected(what, tree));
}

void FieldReader::expect_items(const Tree& tree, const std::string& key, const Rule& rule) {
  if (tree.items.size() < rule.min_items) fail(tree.place, key, "expected entries, got none");
}

/// Refuses {a: 3,5}, which YAML reads as the value 3 of a, and the key 5 without a value.
void FieldReader::refuse_commas(const Tree& map, const std::string& path) {
  for (std::size_t i = 0; i < map.keys.size(); ++i) {
    const std::string hint = comma_hint("0," + map.keys[i]);
    if (map.items[i].kind == Tree::Kind::kNull && !hint.empty())
      fail(map.items[i].place, path.empty() ? map.keys[i] : path + "." + map.keys[i],
           "expected a key with a value, got a number" + hint);
  }
}

void FieldReader::read(const Tree& tree, const std::string& key, double& value, const Rule& rule) {
  double number = 0;
  if (tree.kind != Tree::Kind::kScalar || !parse_double(tree.scalar, number))
    fail(tree.place, key, expected("a number", tree) + comma_hint(tree.scalar));
  if (number < rule.min || number > rule.max || (rule.above_min && number == rule.min))
    fail(tree.place, key, expected(allowed(rule), tree));
  if (rule.above_min && number < rule.min + kLeastAbove)
    fail(tree.place, key, expected(number_text(rule.min + kLeastAbove) + " or more", tree));
  value = number;
}

void FieldReader::read(const Tree& tree, const std::string& key, int& value, const Rule& rule) {
  double number = 0;
  read(tree, key, number, rule);
  if (number != std::floor(number)) fail(tree.place, key, expected("a whole number", tree));
  value = static_cast<int>(number);
}

void FieldReader::read(const Tree& tree, const std::string& key, std::uint64_t& value,
                       const Rule& /*rule*/) {
  const auto number = parse_number<std::uint64_t>(tree.scalar);
  if (tree.kind != Tree::Kind::kScalar || !number)
    fail(tree.place, key, expected("a whole number of 0 or more", tree));
  value = *number;
}

void FieldReader::read(const Tree& tree, const std::string& key, bool& value,
                       const Rule& /*rule*/) {
  if (tree.scalar != "true" && tree.scalar != "false")
    fail(tree.place, key, expected("true or false", tree));
  value = tree.scalar == "true";
}

void FieldReader::read(const Tree& tree, const std::string& key, std::string& value,
                       const Rule& rule) {
  expect(tree, Tree::Kind::kScalar, key, "a text");
  if (find_unprintable(tree.scalar) != std::string::npos)
    fail(tree.place, key, "expected a text in one line, got a control character");
  if (rule.required && tree.scalar.empty())
    fail(tree.place, key, "expected a text, got an empty one");
  value = tree.scalar;
}

void FieldReader::read(const Tree& tree, const std::string& key, Vec2& value, const Rule& rule) {
  expect(tree, Tree::Kind::kSequence, key, "a pair [a, b]");
  if (tree.items.size() != 2)
    fail(tree.place, key, "expected 2 values, got " + std::to_string(tree.items.size()));
  read(tree.items[0], key + ".0", value.x, rule);
  read(tree.items[1], key + ".1", value.y, rule);
}

/// Reads a fraction. The numerator and the denominator are limited, so that products of two such
/// numbers fit into 64 bits.
void FieldReader::read(const Tree& tree, const std::string& key, Fraction& value,
                       const Rule& rule) {
  const std::string_view text = tree.scalar;
  const auto line = std::min(text.find('/'), text.size());
  const auto whole = [](std::string_view part, std::int64_t& number) {
    number = parse_number<std::int64_t>(part).value_or(0);
    return number > 0 && number <= 1'000'000'000;
  };
  Fraction read;
  if (tree.kind != Tree::Kind::kScalar || !whole(text.substr(0, line), read.numerator) ||
      (line < text.size() && !whole(text.substr(line + 1), read.denominator)))
    fail(tree.place, key, expected("a whole number or a fraction such as 8125/4", tree));
  if (read.value() < rule.min || read.value() > rule.max)
    fail(tree.place, key, expected(allowed(rule), tree));
  const std::int64_t divisor = std::gcd(read.numerator, read.denominator);
  value = {read.numerator / divisor, read.denominator / divisor};
}

std::size_t FieldReader::read_name(const Tree& tree, const std::string& key,
                                   std::span<const char* const> names) {
  for (std::size_t i = 0; i < names.size(); ++i)
    if (tree.kind == Tree::Kind::kScalar && tree.scalar == names[i]) return i;
  fail(tree.place, key, expected(listed(names), tree));
}

bool ends_as(std::string_view path, std::string_view pattern) {
  if (pattern.starts_with('.') && std::ranges::count(path, '.') != std::ranges::count(pattern, '.'))
    return false;
  while (!pattern.empty()) {
    const auto step_of = [](std::string_view& text) {
      const std::size_t dot = text.rfind('.');
      const std::size_t begin = dot == std::string_view::npos ? 0 : dot + 1;
      const std::string_view step = text.substr(begin);
      text = text.substr(0, dot == std::string_view::npos ? 0 : dot);
      return step;
    };
    if (path.empty()) return false;
    const std::string_view step = step_of(path), wanted = step_of(pattern);
    if (wanted != "*" && step != wanted) return false;
  }
  return true;
}

void check_current_names(const Tree& tree, const CanonicalKeys& canonical,
                         const std::string& path) {
  for (std::size_t i = 0; i < tree.items.size(); ++i) {
    std::string inner = path;
    if (i < tree.keys.size()) {
      inner += "." + tree.keys[i];
      if (const auto now = current_name(tree.keys[i], path, canonical))
        fail(tree.items[i].place, inner.substr(1),
             "expected " + *now + ", the name of this key since version 0.4, got " + tree.keys[i]);
    }
    check_current_names(tree.items[i], canonical, inner);
  }
}

Tree with_current_names(Tree tree, const CanonicalKeys& canonical, const std::string& path) {
  if (canonical.renamed.empty()) return tree;
  for (std::size_t i = 0; i < tree.items.size(); ++i) {
    std::string inner = path;
    if (i < tree.keys.size()) {
      if (const auto now = current_name(tree.keys[i], path, canonical)) {
        if (tree.find(*now) != nullptr)
          fail(tree.items[i].place, tree.keys[i],
               "expected " + *now + ", the current name, got both names");
        tree.keys[i] = *now;
      }
      inner += "." + tree.keys[i];
    }
    tree.items[i] = with_current_names(std::move(tree.items[i]), canonical, inner);
  }
  return tree;
}

std::string FieldWriter::canonical_name(const std::string& key) const {
  for (const RenamedKey& renamed : canonical_.renamed)
    if (ends_as(path_, renamed.path)) return std::string(renamed.canonical);
  return key;
}

bool FieldWriter::is_left_out(std::string_view value) const {
  return std::ranges::any_of(canonical_.later, [&](const LaterKey& key) {
    return ends_as(path_, key.path) &&
           value.substr(std::min<std::size_t>(1, value.size())) == key.standard;
  });
}

void FieldWriter::write(const Fraction& value) {
  text_ += " " + std::to_string(value.numerator);
  if (value.denominator > 1) text_ += "/" + std::to_string(value.denominator);
}

void FieldWriter::write(const std::string& value) { text_ += " " + quoted(value); }

void FieldWriter::append_entry(const std::string& entry) {
  std::string prefix = "\n" + std::string(indent_ + 2, ' ') + "- ";
  std::size_t begin = 0;
  while (begin <= entry.size()) {
    const std::size_t end = std::min(entry.find('\n', begin), entry.size());
    text_ += prefix + entry.substr(begin, end - begin);
    prefix = "\n" + std::string(indent_ + 4, ' ');
    begin = end + 1;
  }
}

}  // namespace infrasim::config
