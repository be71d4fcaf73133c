#pragma once

#include <atomic>

namespace infrasim::cli {

/// From now on SIGINT and SIGTERM end the process at once, with a message and 128 + the signal.
void hear_signals();

/// From now on the first signal is only noted, so that work can be finished; a second one ends the
/// process at once.
void finish_before_signals();

/// The signal that was noted, else 0.
const std::atomic<int>& noted_signal();

/// What a command that a signal ended says.
void say_stopped(int signal);

}  // namespace infrasim::cli
