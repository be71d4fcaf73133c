#include <malloc.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <csignal>
#include <cstdio>
#include <exception>
#include <new>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "infrasim/cli/commands.h"
#include "infrasim/cli/signals.h"
#include "infrasim/core/errors.h"
#include "infrasim/core/files.h"
#include "infrasim/core/version.h"

namespace {

// Exit codes: 0 for success, 1 for a failure, 2 for wrong usage or configuration.
constexpr int kFailed = 1;
constexpr int kWrong = 2;

int complain(const std::string& text, int code) {
  std::fprintf(stderr, "%s\n", infrasim::printable(text).c_str());
  return code;
}

/// Reports an unknown command by name; CLI11 would only report that a command is missing.
void check_command(const CLI::App& app, int argc, char** argv) {
  if (argc < 2 || argv[1][0] == '-') return;
  std::string names;
  for (const CLI::App* command : app.get_subcommands([](const CLI::App*) { return true; })) {
    if (command->get_name() == argv[1]) return;
    names += (names.empty() ? "" : ", ") + command->get_name();
  }
  throw infrasim::ConfigError("infrasim: expected " + names +
                              " (see --help), got unknown command '" + std::string(argv[1]) + "'");
}

/// Refuses an option with values that is given twice, unless it takes any number of values. CLI11
/// would add the values of the second occurrence to those of the first.
void check_repeats(const CLI::App& app, int argc, char** argv) {
  if (argc < 2) return;
  const auto commands =
      app.get_subcommands([&](const CLI::App* command) { return command->get_name() == argv[1]; });
  std::set<std::string> given;
  for (int i = 2; i < argc && !commands.empty(); ++i) {
    const std::string_view word(argv[i]);
    if (word == "--") return;
    if (!word.starts_with("--")) continue;
    const std::string name(word.substr(0, word.find('=')));
    const CLI::Option* option = commands.front()->get_option_no_throw(name);
    const int most = option == nullptr ? 0 : option->get_items_expected_max();
    if (most == 0 || most >= CLI::detail::expected_max_vector_size) continue;
    if (!given.insert(name).second)
      throw infrasim::ConfigError("infrasim: " + name + ": expected the option once, got it twice");
  }
}

int parse(CLI::App& app, int argc, char** argv) {
  check_command(app, argc, argv);
  check_repeats(app, argc, argv);
  try {
    app.parse(argc, argv);
    return 0;
  } catch (const CLI::ParseError& e) {
    const bool asked_for_help = e.get_exit_code() == 0;
    if (asked_for_help) return app.exit(e);
    const std::string what = e.what();
    const std::vector<std::string_view> words(argv, argv + argc);
    const bool taken = what == "scene is required" && words.at(1) == "run" &&
                       std::ranges::count(words, "--lidar") > 0;
    if (words.size() > 1 && words[1] == "filter" && std::ranges::count(words, "--range") > 0)
      return complain("infrasim: --range: expected --crop-range; renamed in version 0.4", kWrong);
    const char* more = taken ? " before the options, because --lidar takes all words after it" : "";
    return complain("infrasim: " + what + more + " (see --help)", kWrong);
  }
}

}  // namespace

int main(int argc, char** argv) {
  // Frames of several megabytes are allocated and freed continually, so malloc keeps freed memory.
  mallopt(M_MMAP_THRESHOLD, 1 << 28);
  mallopt(M_TRIM_THRESHOLD, 1 << 28);
  infrasim::cli::hear_signals();
  infrasim::record_read_files();
  std::signal(SIGXFSZ, SIG_IGN);  // a file above the size limit then gives an error of write()
  CLI::App app(
      "Simulates roadside LiDARs.\nExample: infrasim run highway "
      "--lidar livox_avia --frames 0:10 --out data/highway",
      "infrasim");
  app.set_version_flag("--version", "infrasim " + std::string(infrasim::version()) + " (frames " +
                                        std::to_string(infrasim::kFramesVersion) + ")");
  app.require_subcommand(1);
  infrasim::cli::CommandResult result;
  infrasim::cli::add_run_command(app, result);
  infrasim::cli::add_check_command(app);
  infrasim::cli::add_keys_command(app);
  infrasim::cli::add_pattern_command(app);
  infrasim::cli::add_trajectories_command(app);
  infrasim::cli::add_filter_command(app);
  infrasim::cli::add_static_command(app);
  try {
    const int code = parse(app, argc, argv);
    if (std::fflush(stdout) != 0 || std::ferror(stdout) != 0)
      return complain("standard output: can't be written", kFailed);
    return code != 0 ? code : result.exit_code;
  } catch (const infrasim::ConfigError& e) {
    return complain(e.what(), kWrong);
  } catch (const std::bad_alloc&) {
    return complain("infrasim: not enough memory; use fewer frames or rays", kFailed);
  } catch (const std::exception& e) {
    return complain(e.what(), kFailed);
  }
}
