#pragma once

namespace infrasim::testing {

/// Number of calls of read() by this thread that still succeed; -1: no limit.
extern thread_local int reads_left;
/// Errors of link() and renameat2() by this thread; 0: the calls work.
extern thread_local int link_error, rename_error;

}  // namespace infrasim::testing
