#pragma once

namespace infrasim::testing {

/// Number of allocations of this thread that succeed before all further allocations fail; -1: none
/// fails.
extern thread_local int allocations_left;

}  // namespace infrasim::testing
