#include "infrasim/config/tree.h"

#include <yaml-cpp/eventhandler.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <map>
#include <optional>
#include <set>
#include <sstream>

#include "infrasim/core/files.h"
#include "infrasim/core/hints.h"
#include "infrasim/core/numbers.h"

namespace infrasim::config {

namespace {

constexpr std::size_t kMaxNodes =
    1'000'000;  // maximum number of values in a file; aliases can expand a small file to any number

Place place_of(const YAML::Mark& mark, const std::string& name) {
  return {name, mark.line + 1, mark.column + 1};
}

constexpr std::uintmax_t kMostYamlBytes = std::uintmax_t{64} << 20;

// maximum number of nested levels; without it, an alias inside its own node would never end
constexpr int kMaxDepth = 64;

struct Converter {
  const std::string& name;
  std::size_t nodes = 0;
  int depth = 0;

  Tree convert(const YAML::Node& node) {
    Tree tree;
    tree.place = place_of(node.Mark(), name);
    if (++nodes > kMaxNodes)
      fail(tree.place, "(document)", "expected at most 1000000 values, got more");
    if (++depth > kMaxDepth) fail(tree.place, "(document)", "expected at most 64 levels, got more");
    switch (node.Type()) {
      case YAML::NodeType::Undefined:
      case YAML::NodeType::Null:
        break;
      case YAML::NodeType::Scalar:
        tree.kind = Tree::Kind::kScalar;
        tree.scalar = node.Scalar();
        break;
      case YAML::NodeType::Sequence:
        tree.kind = Tree::Kind::kSequence;
        for (const auto& item : node) tree.items.push_back(convert(item));
        break;
      case YAML::NodeType::Map:
        convert_map(node, tree);
        break;
    }
    --depth;
    return tree;
  }

  void convert_map(const YAML::Node& node, Tree& tree) {
    tree.kind = Tree::Kind::kMap;
    std::set<std::string> seen;
    for (const auto& entry : node) {
      const Place key_place = place_of(entry.first.Mark(), name);
      if (!entry.first.IsScalar())
        fail(key_place, "(key)", "expected a word, got another kind of key");
      const std::string& key = entry.first.Scalar();
      if (!seen.insert(key).second)
        fail(key_place, key, "expected the key once, got it twice" + comma_hint("0," + key));
      Tree value = convert(entry.second);
      if (value.place.line == 0) value.place = key_place;
      tree.keys.push_back(key);
      tree.items.push_back(std::move(value));
    }
  }
};

/// Records where the last document of a YAML text starts, and ignores its content.
class DocumentPlaces : public YAML::EventHandler {
 public:
  YAML::Mark last;

  void OnDocumentStart(const YAML::Mark& mark) override { last = mark; }
  void OnDocumentEnd() override {}
  void OnNull(const YAML::Mark&, YAML::anchor_t) override {}
  void OnAlias(const YAML::Mark&, YAML::anchor_t) override {}
  void OnScalar(const YAML::Mark&, const std::string&, YAML::anchor_t,
                const std::string&) override {}
  void OnSequenceStart(const YAML::Mark&, const std::string&, YAML::anchor_t,
                       YAML::EmitterStyle::value) override {}
  void OnSequenceEnd() override {}
  void OnMapStart(const YAML::Mark&, const std::string&, YAML::anchor_t,
                  YAML::EmitterStyle::value) override {}
  void OnMapEnd() override {}
};

/// Returns where the second document of a YAML text starts, if there is one. The documents are read
/// one by one, because yaml-cpp's LoadAll never ends on a stray comma.
std::optional<YAML::Mark> second_document(const std::string& text) {
  std::istringstream in(text);
  YAML::Parser parser(in);
  DocumentPlaces places;
  if (parser.HandleNextDocument(places) && parser.HandleNextDocument(places)) return places.last;
  return std::nullopt;
}

/// Returns the child of a node for one step of a dotted path. A child that is missing in a map is
/// created.
Tree& child(Tree& tree, const std::string& step, const std::string& option) {
  if (tree.kind == Tree::Kind::kSequence) {
    const auto index = parse_number<std::size_t>(step);
    if (!index || *index >= tree.items.size())
      fail({option}, step,
           "expected the index of a list entry, 0 to below " + std::to_string(tree.items.size()) +
               ", got no such list entry");
    return tree.items[*index];
  }
  if (tree.kind == Tree::Kind::kScalar)
    fail({option}, step, "expected a map or a list, got a plain value");
  tree.kind = Tree::Kind::kMap;
  const auto at = std::ranges::find(tree.keys, step) - tree.keys.begin();
  if (at < std::ssize(tree.keys)) return tree.items[static_cast<std::size_t>(at)];
  tree.keys.push_back(step);
  tree.items.emplace_back();
  tree.items.back().place = {option};
  return tree.items.back();
}

}  // namespace

const Tree* Tree::find(std::string_view key) const {
  const auto it = std::ranges::find(keys, key);
  return it == keys.end() ? nullptr : &items[static_cast<std::size_t>(it - keys.begin())];
}

std::optional<Tree> take(Tree& map, std::string_view key) {
  const auto at = std::ranges::find(map.keys, key) - map.keys.begin();
  if (at == std::ssize(map.keys)) return std::nullopt;
  Tree value = std::move(map.items[static_cast<std::size_t>(at)]);
  map.keys.erase(map.keys.begin() + at);
  map.items.erase(map.items.begin() + at);
  return value;
}

std::string start_of(const KeyPlace& at) {
  const Place& place = at.place;
  std::string text = place.file;
  if (place.line > 0) text += ":" + std::to_string(place.line) + ":" + std::to_string(place.column);
  return text + ": " + at.key + ": ";
}

void fail(const Place& place, std::string_view key, std::string_view what) {
  std::string text = start_of({place, std::string(key)}) + std::string(what);
  std::ranges::replace(text, '\n', ' ');
  throw ConfigError(text);
}

/// Rejects control characters and bytes that are not UTF-8. yaml-cpp would stop reading at some of
/// these bytes, and would replace others.
void check_characters(const std::string& text, const std::string& name) {
  for (auto at = find_unprintable(text); at != std::string::npos;
       at = find_unprintable(text, at + 1)) {
    const char byte = text[at];
    if (byte == '\n' || byte == '\r' || byte == '\t') continue;
    const auto line_start = text.rfind('\n', at) + 1;  // in the first line, npos + 1 is 0
    const auto line = std::count(text.begin(), text.begin() + static_cast<long>(at), '\n') + 1;
    fail({name, static_cast<int>(line), static_cast<int>(at - line_start) + 1}, "(document)",
         "expected printable text in UTF-8, got the byte " + std::string(1, byte));
  }
}

Tree parse_tree(const std::string& text, const std::string& name) {
  check_characters(text, name);
  try {
    if (const auto second = second_document(text))
      fail(place_of(*second, name), "(document)", "expected one document, got a second document");
    return Converter{name}.convert(YAML::Load(text));
  } catch (const YAML::Exception& e) {
    fail(place_of(e.mark, name), "(document)", "expected YAML, got malformed text (" + e.msg + ")");
  }
}

Tree read_tree(const std::filesystem::path& file) {
  return parse_tree(read_file(file, kMostYamlBytes), file.string());
}

Tree merged(const Tree& base, const Tree& over) {
  if (base.kind != Tree::Kind::kMap || over.kind != Tree::Kind::kMap) return over;
  Tree out = base;
  std::map<std::string_view, std::size_t> place;
  for (std::size_t i = 0; i < base.keys.size(); ++i) place[base.keys[i]] = i;
  for (std::size_t i = 0; i < over.keys.size(); ++i) {
    if (const auto it = place.find(over.keys[i]); it != place.end()) {
      out.items[it->second] = merged(base.items[it->second], over.items[i]);
    } else {
      out.keys.push_back(over.keys[i]);
      out.items.push_back(over.items[i]);
    }
  }
  return out;
}

void override_value(Tree& root, const std::string& assignment) {
  const std::string option = "--set " + assignment;
  const auto equals = assignment.find('=');
  const std::string key = assignment.substr(0, equals);
  if (equals == std::string::npos || key.empty() || key.starts_with('.') || key.ends_with('.') ||
      key.find("..") != std::string::npos)
    fail({option}, "(option)", "expected KEY=VALUE with a dotted KEY, got '" + assignment + "'");
  Tree* at = &root;
  std::istringstream path(key);
  for (std::string step; std::getline(path, step, '.');) at = &child(*at, step, option);
  *at = parse_tree(assignment.substr(equals + 1), option);
  at->place = {option};
}

}  // namespace infrasim::config
