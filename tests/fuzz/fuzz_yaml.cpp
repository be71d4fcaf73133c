#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string>

#include "infrasim/config/scene_config.h"
#include "infrasim/config/tree.h"

// Input: one line with a KEY=VALUE assignment, then a YAML text. Whatever they are, they are read
// or refused with a ConfigError; a scene that is read dumps to a text that reads back to the same
// dump.

namespace {

using namespace infrasim;

/// The keys that a scene must have, so that an input of a few bytes can add one more.
constexpr char kRequired[] = R"(name: n
mounts: {m: {x_m: 0, y_m: 0, z_m: 6}}
roads:
  - {name: r, start: {x_m: 0, y_m: 0}, centreline: [{line_m: 9}], lanes: {each_way: 1}}
)";

void read_as_tree(const std::string& text, const std::string& assignment) {
  try {
    config::Tree tree = config::parse_tree(text, "fuzz");
    tree = config::merged(config::parse_tree(kRequired, "required"), tree);
    config::override_value(tree, assignment);
  } catch (const ConfigError&) {
  }
}

void read_as_scene(const std::string& text) {
  std::string dumped;
  try {
    dumped = dump_scene(parse_scene(text, "fuzz"));
  } catch (const ConfigError&) {
    return;
  }
  if (dump_scene(parse_scene(dumped, "dump")) != dumped) std::abort();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string input(reinterpret_cast<const char*>(data), size);
  const std::size_t end = std::min(input.find('\n'), size);
  const std::string text = end < size ? input.substr(end + 1) : "";
  read_as_tree(text, input.substr(0, end));
  read_as_scene(text);
  read_as_scene(kRequired + text);
  return 0;
}
