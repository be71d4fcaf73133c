#include "infrasim/sensor/echo_merge.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace infrasim {

void EchoMerger::merge(const EchoBatch& sub_echoes, std::span<const WeakerEcho> weaker,
                       std::span<const std::uint32_t> beams, std::span<const std::uint16_t> rings,
                       EchoBatch& echoes, std::vector<float>& sunlit,
                       std::vector<WeakerEcho>* others) {
  const std::size_t n = shares_.size();
  auto next = weaker.begin();
  for (std::size_t k = 0; k < beams.size(); ++k) {
    const std::size_t ray = beams[k], first = n * k;
    parts_.clear();
    const auto add = [&](const Echo& echo, float share) {
      parts_.push_back(
          {echo.range, share * echo.reflectance * echo.gain, echo.object, echo.class_id});
    };
    float lit = 0;
    for (std::size_t j = 0; j < n; ++j) {
      const std::size_t i = first + j;
      if (!std::isfinite(sub_echoes.range[i])) continue;
      lit += shares_[j] * sub_echoes.reflectance[i];
      add(sub_echoes.at(i), shares_[j]);
    }
    for (; next != weaker.end() && next->ray < first + n; ++next)
      add(next->echo, shares_[next->ray - first]);
    sunlit[ray] = lit;
    echoes.range[ray] = std::numeric_limits<float>::infinity();
    echoes.object[ray] = -1;
    for (bool strongest = true; !parts_.empty(); strongest = false) {
      const Sum sum = strongest_sum(rings[ray]);
      if (sum.received == 0) break;
      if (strongest)
        echoes.set(ray, sum.echo);
      else
        others->push_back({static_cast<std::uint32_t>(ray), sum.echo});
      if (others == nullptr) break;
      const float middle = parts_[sum.around].range;
      std::erase_if(parts_, [&](const PartialEcho& part) {
        return std::abs(part.range - middle) <= separation_m_ ||
               std::abs(part.range - sum.echo.range) <= separation_m_;
      });
    }
  }
}

/// Returns the sum of parts with the highest received power. Its power is 0 if there is none beyond
/// the blind zone.
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

/// Returns the sum of the parts within the separation of part `a`, without the losses of the path.
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
