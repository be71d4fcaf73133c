#pragma once

namespace CLI {
class App;
}

namespace infrasim::cli {

/// Result of a command.
struct CommandResult {
  int exit_code = 0;
};

// Each function adds one subcommand, whose callback throws ConfigError or IoError.
void add_run_command(CLI::App& app, CommandResult& result);
void add_check_command(CLI::App& app);
void add_keys_command(CLI::App& app);
void add_pattern_command(CLI::App& app);
void add_trajectories_command(CLI::App& app);
void add_filter_command(CLI::App& app);
void add_static_command(CLI::App& app);

}  // namespace infrasim::cli
