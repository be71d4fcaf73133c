#pragma once

#include <atomic>

namespace infrasim::cli {

/// Makes SIGINT and SIGTERM end the process at once, with a message and exit code 128 + signal.
void hear_signals();

/// After this call, the first SIGINT or SIGTERM only sets a flag, so that running work can finish.
/// A second signal ends the process at once.
void finish_before_signals();

/// Returns the number of the first signal after `finish_before_signals`; 0 if there was none.
const std::atomic<int>& noted_signal();

/// Prints that a signal has stopped the command.
void say_stopped(int signal);

}  // namespace infrasim::cli
