#pragma once

#include <filesystem>
#include <span>
#include <vector>

#include "infrasim/pipeline/world.h"
#include "infrasim/scene/trajectory_text.h"

namespace infrasim {

/// Returns which rows of trajectories.csv the folder of a run needs: the rows of its frames, or all
/// rows if the scene has recorded trajectories. With all rows, the scene can be simulated again.
std::vector<bool> rows_of_run(const SceneConfig& scene, std::span<const int> frames,
                              double period_s);

/// Adds rows of a world's trajectories to a trajectories.csv, in the time of the mount's clock. The
/// text depends only on the rows that the file has afterwards, and not on the order in which they
/// were added. The file is replaced in one step, or not changed if it has all rows. Several
/// processes may call this function at the same time, because it locks the file's folder.
/// @param rows which rows the file must have
/// @throws IoError if the file can't be written, or if one of these rows in the existing file has
///   other objects
void merge_trajectories(const std::filesystem::path& file, const World& world,
                        const std::vector<bool>& rows);

}  // namespace infrasim
