#include "infrasim/filter/filter.h"

#include "infrasim/filter/points.h"

namespace infrasim {

std::vector<int> apply(const FilterStep& step, std::span<const float> xyz) {
  return std::visit([&](const auto& s) { return keep(xyz, s); }, step);
}

std::vector<int> keep_all(std::span<const FilterStep> steps, std::span<const float> xyz,
                          const StepObserver& observer) {
  std::vector<int> kept = keep_if(xyz, [](Vec3) { return true; });
  for (const FilterStep& step : steps) {
    std::vector<float> rest;
    rest.reserve(3 * kept.size());
    for (const int i : kept) rest.insert(rest.end(), {xyz[3 * i], xyz[3 * i + 1], xyz[3 * i + 2]});
    std::vector<int> next = infrasim::apply(step, rest);  // the qualifier avoids std::apply
    for (int& i : next) i = kept[i];
    if (observer) observer(step, kept.size(), next.size());
    kept = std::move(next);
  }
  return kept;
}

}  // namespace infrasim
