#pragma once

#include <tuple>
#include <type_traits>

#include "infrasim/config/fields.h"
#include "infrasim/core/filter_steps.h"

// Declares the name and the parameters of every filter. The keys of a scene, the options of
// `infrasim filter` and the classes in Python are made from these declarations. A new filter
// requires a struct and an entry in FilterOf (core/filter_steps.h), a declaration here, and a
// function `keep` in filter/.

namespace infrasim::config {

/// A parameter of a filter: its name in scene files and in Python, and its allowed values.
template <class Filter, class T, bool kRequired>
struct Parameter {
  static constexpr bool required = kRequired;
  const char* name;
  T Filter::* member;
  const char* doc;
  Rule rule;
};

template <class Filter, class T>
Parameter<Filter, T, false> optional(const char* name, T Filter::* member, const char* doc,
                                     Rule rule) {
  return {name, member, doc, rule};
}

template <class Filter, class T>
Parameter<Filter, T, true> required(const char* name, T Filter::* member, const char* doc,
                                    Rule rule = {}) {
  return {name, member, doc, required(rule)};
}

template <class... Parameters>
struct FilterDeclaration {
  const char*
      key;  ///< key of an entry in a scene's `filters`; the Python class has this name in CamelCase
  const char* doc;        ///< description of the filter in the list of keys
  const char* docstring;  ///< docstring of the filter's class in Python
  std::tuple<Parameters...> parameters;
};

template <class... Parameters>
FilterDeclaration<Parameters...> declare(const char* key, const char* doc, const char* docstring,
                                         Parameters... parameters) {
  return {key, doc, docstring, {parameters...}};
}

template <class Filter>
using Of = std::type_identity<Filter>;

/// Calls use(Of<Filter>) for every filter, in the order of FilterOf.
template <class... Filters, class Use>
void for_each_filter(Of<std::variant<Filters...>>, const Use& use) {
  (use(Of<Filters>{}), ...);
}

inline auto declaration(Of<CropBox>) {
  return declare(
      "crop_box", "keeps the points in a box",
      "Keeps min_m <= point <= max_m, each (x, y, z) in metres.",
      required("min_m", &CropBox::min_m, "smallest coordinate, in the levelled LiDAR frame"),
      required("max_m", &CropBox::max_m, "largest coordinate, in the levelled LiDAR frame"));
}

inline auto declaration(Of<CropPolygon>) {
  return declare("crop_polygon", "keeps the points in an outline",
                 "Keeps points inside corners (x, y) in metres.",
                 required("outline_m", &CropPolygon::outline_m,
                          "corners x y in order, in the levelled LiDAR frame"));
}

inline auto declaration(Of<CropRange>) {
  return declare("crop_range", "keeps the points in a span of ranges",
                 "Keeps min_m <= slant range <= max_m.",
                 optional("min_m", &CropRange::min_m, "lowest slant range", between(0, 1e5)),
                 required("max_m", &CropRange::max_m, "highest slant range", positive(1e5)));
}

inline auto declaration(Of<CropFieldOfView>) {
  using Filter = CropFieldOfView;
  const Rule turn = between(-180, 180), tilt = between(-90, 90);
  return declare(
      "crop_field_of_view", "keeps the points in a span of angles",
      "Keeps an interval of azimuth, from min towards +y up to max, and of elevation; degrees.",
      optional("azimuth_min_deg", &Filter::azimuth_min_deg,
               "azimuth at which the span begins; it runs from +x towards +y", turn),
      optional("azimuth_max_deg", &Filter::azimuth_max_deg, "azimuth at which the span ends", turn),
      optional("elevation_min_deg", &Filter::elevation_min_deg, "lowest angle above the horizon",
               tilt),
      optional("elevation_max_deg", &Filter::elevation_max_deg, "highest angle above the horizon",
               tilt));
}

inline auto declaration(Of<GroundHeight>) {
  return declare("ground_height", "keeps the points above a height",
                 "Keeps points with z > z_m; ignores slopes.",
                 required("z_m", &GroundHeight::z_m,
                          "height in the levelled LiDAR frame; points at or below it are removed"));
}

inline auto declaration(Of<GroundPlane>) {
  return declare(
      "ground_plane", "removes the points of one plane",
      "Removes points within distance_m of the largest nearly level plane (RANSAC of PCL). If "
      "sensor_height_m is not 0, the plane must be this far below the sensor.",
      optional("distance_m", &GroundPlane::distance_m,
               "largest distance of removed points from the plane", positive(10)),
      optional(
          "sensor_height_m", &GroundPlane::sensor_height_m,
          "height of the sensor above the ground; 0: the height of the mount above the first road",
          between(0, 1000)),
      optional("max_tilt_deg", &GroundPlane::max_tilt_deg,
               "largest angle between the plane and the horizontal", positive(89.9)));
}

inline auto declaration(Of<GroundMorphological>) {
  using Filter = GroundMorphological;
  return declare(
      "ground_morphological", "removes the points of roads, slopes and terrain",
      "Removes roads, slopes and terrain: surfaces wider than window_m, and points up to height_m "
      "above them.",
      optional("window_m", &Filter::window_m, "objects wider than this are ground",
               between(1, 100)),
      optional("height_m", &Filter::height_m,
               "points up to this height above the ground are removed too", positive(10)),
      optional("cell_m", &Filter::cell_m, "side of a grid cell", between(0.05, 10)),
      optional("azimuth_cell_deg", &Filter::azimuth_cell_deg,
               "width of the sectors in which gaps are filled", between(0.05, 10)),
      optional("max_range_m", &Filter::max_range_m, "points at a greater range are kept",
               positive(600)));
}

/// Declares the background filter. The Python class is the model that is learnt from frames.
inline auto declaration(Of<BackgroundFilter>) {
  using Filter = BackgroundFilter;
  return declare(
      "background", "removes the points of the static scene",
      "Model of the static scene for one fixed sensor; as a filter step, it removes the points of "
      "this scene.",
      optional("frames", &Filter::frames,
               "number of frames without vehicles from which the model is learnt",
               between(1, 1000)),
      optional("azimuth_cell_deg", &Filter::azimuth_cell_deg, "width of a cell of the model",
               between(0.05, 10)),
      optional("elevation_cell_deg", &Filter::elevation_cell_deg, "height of a cell of the model",
               between(0.05, 10)),
      optional("range_margin_m", &Filter::range_margin_m,
               "points up to this distance in front of the background are removed too",
               between(0, 10)),
      optional("height_margin_m", &Filter::height_margin_m,
               "points up to this height above the background are removed too", between(0, 10)));
}

}  // namespace infrasim::config
