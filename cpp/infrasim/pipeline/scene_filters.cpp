#include "infrasim/pipeline/scene_filters.h"

namespace infrasim {

std::vector<FilterStep> make_filters(const std::vector<FilterConfig>& filters,
                                     const std::function<std::vector<float>(int)>& empty_frame) {
  std::vector<FilterStep> steps;
  for (const FilterConfig& f : filters) {
    if (f.crop_box) steps.emplace_back(*f.crop_box);
    if (f.crop_polygon) steps.emplace_back(*f.crop_polygon);
    if (f.crop_range) steps.emplace_back(*f.crop_range);
    if (f.crop_field_of_view) steps.emplace_back(*f.crop_field_of_view);
    if (f.ground_height) steps.emplace_back(*f.ground_height);
    if (f.ground_plane) steps.emplace_back(*f.ground_plane);
    if (f.ground_morphological) steps.emplace_back(*f.ground_morphological);
    if (!f.background) continue;
    std::vector<std::vector<float>> frames;
    for (int k = 0; k < f.background->frames; ++k) frames.push_back(empty_frame(k));
    steps.emplace_back(learn_background(frames, f.background->learning));
  }
  return steps;
}

}  // namespace infrasim
