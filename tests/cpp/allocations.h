#pragma once

namespace infrasim::testing {

/// How many allocations of this thread succeed before each one fails; -1: none fails.
extern thread_local int allocations_left;

}  // namespace infrasim::testing
