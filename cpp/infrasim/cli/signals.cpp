#include "infrasim/cli/signals.h"

#include <unistd.h>

#include <csignal>
#include <string_view>

namespace infrasim::cli {

namespace {

std::atomic<int> g_signal = 0;  // a signal handler can only use global variables
std::atomic<bool> g_finish = false;
static_assert(std::atomic<int>::is_always_lock_free);

void on_signal(int number) {
  if (g_finish && g_signal.exchange(number) == 0) return;
  say_stopped(number);
  ::_exit(128 + number);
}

void put(std::string_view text) {
  // The result is ignored, because nothing can be done if standard error is closed.
  [[maybe_unused]] const auto written = ::write(STDERR_FILENO, text.data(), text.size());
}

}  // namespace

void hear_signals() {
  std::signal(SIGINT, on_signal);
  std::signal(SIGTERM, on_signal);
}

void finish_before_signals() { g_finish = true; }

const std::atomic<int>& noted_signal() { return g_signal; }

/// This function is safe in a signal handler. SIGINT has the number 2, and SIGTERM has 15.
void say_stopped(int signal) {
  put(signal == SIGINT ? "stopped by signal 2" : "stopped by signal 15");
  put("; the same command resumes\n");
}

}  // namespace infrasim::cli
