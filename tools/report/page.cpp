#include <fmt/format.h>

#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>

#include "common/page/html.hpp"
#include "common/rt/histogram.hpp"
#include "tools/report/results.hpp"

namespace ledgerline::report {

extern const char page_template[];  // page.html, put into the program by CMake

namespace {

using nlohmann::json;

// Enough for the eye, and a page that opens at once.
constexpr std::size_t points_in_page = 30'000, max_modes = 500;

template <typename T, typename Make>
json thinned(const std::vector<T>& all, std::size_t most, Make make) {
  json list = json::array();
  const std::size_t step = all.size() / std::max<std::size_t>(most, 1) + 1;
  for (std::size_t i = 0; i < all.size(); i += step) list.push_back(make(all[i]));
  return list;
}

json to_json(const PublishedBox& box) {
  return {{"name", std::string(box.name)}, {"low_s", box.low_s}, {"q1_s", box.q1_s},
          {"median_s", box.median_s},      {"q3_s", box.q3_s},   {"high_s", box.high_s}};
}

json page_data(const Results& results) {
  json data = to_json(results);
  const std::size_t each = points_in_page / std::max<std::size_t>(1, 6 * results.drones.size());
  for (std::size_t i = 0; i < results.drones.size(); ++i) {
    const DroneResult& drone = results.drones[i];
    json& out = data["drones"][i];
    const auto sample = [](const Sample& s) { return json{rounded(s.t_s), rounded(s.ms)}; };
    const auto point = [](const std::array<double, 2>& p) { return json{rounded(p[0]), rounded(p[1])}; };
    out["two_way"] = thinned(drone.two_way, each, sample);
    out["age"] = thinned(drone.age, each, sample);
    out["flown"] = thinned(drone.flown, 2 * each, point);
    out["reported"] = thinned(drone.reported, each, [](const ReportedPosition& one) {
      return json{rounded(one.t_s), rounded(one.three_sigma_m), one.error_m ? json(rounded(*one.error_m)) : json()};
    });
    out["moments"] = thinned(drone.moments, each, [](const FlownMoment& one) {
      const bool placed = std::isfinite(one.position_m[0]);
      return json{rounded(one.t_s), rounded(one.position_m[2]), placed ? json(rounded(one.speed_mps)) : json(),
                  one.battery > 0 ? json(rounded(100 * one.battery, 10)) : json()};
    });
    out["modes"] = thinned(drone.modes, max_modes, [](const ModeChange& one) {
      return json{rounded(one.t_s), one.phase, one.mode, one.cause};
    });
    out["wanted"] = thinned(drone.wanted, drone.wanted.size() + 1, point);
  }
  data["all"] = {{"two_way_ms", results.two_way_ms}, {"age_ms", results.age_ms}};
  data["published"] = json::array();
  for (const PublishedBox& box : published_boxes) data["published"].push_back(to_json(box));
  data["published_beside"] = to_json(published_for(ground::name_of(results.asked.shape), results.asked.drones));
  data["differences"] = differences(results);
  data["fault_lines"] = fault_lines(results);
  data["no_truth"] = results.asked.own ? no_truth : "";
  data["date"] = page::local_date();
  if (!data.contains("why")) data["why"] = "";
  return data;
}

}  // namespace

Result<std::string> to_page(const Results& results, const std::string& chart_js) {
  std::ifstream file(chart_js);
  const std::string script((std::istreambuf_iterator<char>(file)), {});
  if (script.empty()) return Error{fmt::format("{} cannot be read: apt-get install libjs-chart.js", chart_js)};
  const std::string page = page::filled(page_template, "@DATA@", page::for_script(page_data(results)));
  return page::filled(page, "@CHART_JS@", script);
}

}  // namespace ledgerline::report
