#include "infrasim/pipeline/frame_stream.h"

namespace infrasim {

FrameStream::FrameStream(const World& world, const std::vector<LidarConfig>& lidars,
                         std::vector<int> frames, int threads)
    : scheduler_(world, lidars,
                 {.frames = std::move(frames),
                  .threads = threads,
                  .ahead = 2 * static_cast<std::size_t>(threads)},
                 [all = std::vector<bool>(lidars.size(), true)](FrameSimulator& simulator, int k) {
                   return simulator.simulate(k, all);
                 }) {}

}  // namespace infrasim
