#include "infrasim/sensor/echo_merge.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace infrasim {

void EchoMerger::merge(std::span<const SubRay> sub_rays, const EchoBatch& sub_echoes,
                       std::span<const WeakerEcho> weaker, std::span<const std::uint32_t> beams,
                       std::span<const std::uint16_t> rings, EchoBatch& echoes,
                       std::vector<float>& sunlit, std::vector<WeakerEcho>* others) {
  // Sorts the echoes of all sub-rays by beam. The echoes of beam b end at `end[b + 1]`.
  std::vector<std::uint32_t> end(beams.size() + 1);
  const auto add = [&](std::uint32_t beam) { ++end[beam + 1]; };
  for (std::size_t i = 0; i < sub_rays.size(); ++i)
    if (std::isfinite(sub_echoes.range[i])) add(sub_rays[i].beam);
  for (const WeakerEcho& one : weaker) add(sub_rays[one.ray].beam);
  for (std::size_t beam = 0; beam < beams.size(); ++beam) end[beam + 1] += end[beam];
  std::vector<PartialEcho> all(end.back());
  std::vector<std::uint32_t> next(end.begin(), end.end() - 1);
  for (const std::uint32_t ray : beams) sunlit[ray] = 0;
  const auto put = [&](const SubRay& sub, const Echo& echo) {
    all[next[sub.beam]++] = {echo.range, sub.share * echo.reflectance * echo.gain, echo.object,
                             echo.class_id};
  };
  for (std::size_t i = 0; i < sub_rays.size(); ++i) {
    if (!std::isfinite(sub_echoes.range[i])) continue;
    put(sub_rays[i], sub_echoes.at(i));
    sunlit[beams[sub_rays[i].beam]] += sub_rays[i].share * sub_echoes.reflectance[i];
  }
  for (const WeakerEcho& one : weaker) put(sub_rays[one.ray], one.echo);

  for (std::size_t beam = 0; beam < beams.size(); ++beam) {
    const std::uint32_t ray = beams[beam];
    parts_.assign(all.begin() + end[beam], all.begin() + end[beam + 1]);
    echoes.range[ray] = std::numeric_limits<float>::infinity();
    echoes.object[ray] = -1;
    for (bool strongest = true; !parts_.empty(); strongest = false) {
      const Sum sum = strongest_sum(rings[ray]);
      if (sum.received == 0) break;
      if (strongest)
        echoes.set(ray, sum.echo);
      else
        others->push_back({ray, sum.echo});
      if (others == nullptr) break;
      const float middle = parts_[sum.around].range;
      std::erase_if(parts_, [&](const PartialEcho& part) {
        return std::abs(part.range - middle) <= separation_m_ ||
               std::abs(part.range - sum.echo.range) <= separation_m_;
      });
    }
  }
}

/// Returns the sum of partial echoes with the highest received power. This power is 0 if no sum is
/// beyond the blind zone.
EchoMerger::Sum EchoMerger::strongest_sum(std::uint16_t ring) const {
  const auto [nearest, farthest] =
      std::ranges::minmax(parts_, {}, [](const PartialEcho& part) { return part.range; });
  const bool one_sum = farthest.range - nearest.range <= separation_m_;
  Sum best;
  for (std::size_t a = 0; a < (one_sum ? 1 : parts_.size()); ++a) {
    Sum sum = sum_around(a);
    sum.received *= path_.share(sum.echo.range, ring);
    if (sum.received > best.received) best = sum;
  }
  return best;
}

/// Returns the sum of the partial echoes that are at most `separation_m_` away from partial echo
/// `a`. The attenuation on the path is not included.
EchoMerger::Sum EchoMerger::sum_around(std::size_t a) const {
  float power = 0, weighted_range = 0, reflected = 0, best = 0;
  const PartialEcho* strongest = &parts_[a];
  for (const PartialEcho& part : parts_) {
    if (!(std::abs(part.range - parts_[a].range) <= separation_m_)) continue;
    const float one = part.reflected / (part.range * part.range);
    power += one;
    weighted_range += one * part.range;
    reflected += part.reflected;
    if (one > best) best = one, strongest = &part;
  }
  return {.echo = {weighted_range / power, strongest->object, strongest->class_id, reflected, 1},
          .received = power,
          .around = a};
}

}  // namespace infrasim
