#include "infrasim/pipeline/scene_filters.h"

namespace infrasim {

std::vector<FilterStep> make_filters(const std::vector<FilterConfig>& filters,
                                     const std::function<std::vector<float>(int)>& empty_frame) {
  std::vector<FilterStep> steps;
  const auto add = [&]<class Filter>(const Filter& filter) {
    if constexpr (std::is_same_v<Filter, BackgroundFilter>) {
      std::vector<std::vector<float>> frames;
      for (int k = 0; k < filter.frames; ++k) frames.push_back(empty_frame(k));
      steps.emplace_back(learn_background(frames, filter));
    } else {
      steps.emplace_back(filter);
    }
  };
  for (const FilterConfig& f : filters) std::visit(add, f.step);
  return steps;
}

}  // namespace infrasim
