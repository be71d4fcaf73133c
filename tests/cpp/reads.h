#pragma once

namespace infrasim::testing {

/// Number of calls of read() by this thread that still succeed; -1: no limit.
extern thread_local int reads_left;

}  // namespace infrasim::testing
