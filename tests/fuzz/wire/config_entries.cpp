#include <cmath>

#include "common/config/config.hpp"
#include "ground/shell/settings.hpp"
#include "tests/fuzz/entry.hpp"

/// TOML files as a person may write them: the reader, and ground's settings.
namespace ledgerline::fuzz::config_part {
namespace {

const std::string ground_toml =
    "# a flight\n[flight]\nshape = \"square\"\nside_m = 1.5\nlaps = 3\nseconds = 0.0\nspeed_mps = 0.5\nheight_m = 1\n"
    "lag_s = 0.3\n\n[[drone]]\nname = \"tello1\"\nnumber = 1\n[[drone]]\nname = \"tello2\"\n\n"
    "[output]\ntrace = \"a.trace\"\nsummary = \"a.json\"\nstatus_period_ms = 250\n";
const std::string bridged = "[[topic]]\nname = \"/tello1/*\"\ndirection = \"from_ledger\"\nfrom = \"tello1\"\n";

Outcome every_type(std::string_view bytes) {
  auto config = Config::parse(bytes, "x.toml");
  if (!config) return refused(config.error().message);
  (void)config->text("flight.shape");
  (void)config->text("output.trace", "");
  (void)config->text("output.summary", "");
  (void)config->choice("flight.mode", {"a", "b"}, "a");
  (void)config->boolean("flight.wind", true);
  (void)config->integer("flight.laps", 3, 1, 10);
  (void)config->integer("output.status_period_ms", 3, 1, 1000);
  const double number = config->number("flight.side_m", 0.2, 50);
  for (const char* key : {"flight.seconds", "flight.speed_mps", "flight.height_m", "flight.lag_s"}) {
    (void)config->number(key, 0, 0, 10);
  }
  const auto corner = config->numbers("flight.corner_m", 3, {1, 2, 3});
  for (std::size_t i = 0; i < config->table_count("drone"); ++i) {
    (void)config->text("drone." + std::to_string(i) + ".name");
    (void)config->integer("drone." + std::to_string(i) + ".number", 1, 1, 16);
  }
  const Status status = config->finish();
  if (!status) return refused(status.error().message);
  for (const double value : corner) {
    if (!std::isfinite(value)) return refused("");
  }
  return corner.size() == 3 && number >= 0.2 && number <= 50 ? accepted() : refused("");
}

Outcome ground_settings(std::string_view bytes) {
  auto config = Config::parse(bytes, "ground.toml");
  if (!config) return refused(config.error().message);
  const ground::FlightConfig flight = ground::flight_config(*config);
  (void)ground::output_settings(*config);
  (void)ground::read_bridge(*config, flight.drones);
  const Status status = config->finish();
  if (!status) return refused(status.error().message);
  return flight.side_m > 0 && flight.controller.speed_mps > 0 ? accepted() : refused("");
}

std::unique_ptr<Entry> make_every_type() {
  return std::make_unique<Function>(
      std::vector<std::string>{ground_toml,
                               "flight.shape = 'x'\nflight.side_m = 2\nflight.corner_m = [1.0, 2, -3e2]\n"
                               "flight.wind = false\nflight.mode = \"b\"\n",
                               "flight = { shape = \"\"\"x y\"\"\", side_m = +1.0e1, laps = 0x3 }\n"
                               "drone = [ { name = 'a', number = 1_6 }, { name = \"\\u00e9\" } ]\n"},
      every_type);
}

const Registration toml({"config.toml", Kind::toml, make_every_type});
const Registration ground_config({"config.ground", Kind::toml, [] {
                                    return std::make_unique<Function>(
                                        std::vector<std::string>{ground_toml,
                                                                 "[[drone]]\nname = \"tello1\"\n" + bridged},
                                        ground_settings);
                                  }});

}  // namespace
}  // namespace ledgerline::fuzz::config_part
