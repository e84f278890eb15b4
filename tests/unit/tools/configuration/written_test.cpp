#include <gtest/gtest.h>

#include <filesystem>

#include "tools/configuration/config_file.hpp"
#include "tools/launcher/configs.hpp"

namespace ledgerline::configuration {
namespace {

/// What the programs say of the configs that a flight writes for them.
void expect_read(const launcher::Options& options) {
  const std::string folder = testing::TempDir() + "written-configs";
  std::filesystem::create_directories(folder);
  const launcher::RunFiles files{folder};
  ASSERT_TRUE(write_configs(files, options, {"127.0.0.1:1", {"127.0.0.1:2"}, {"127.0.0.1:1", "127.0.0.1:3"}}));
  ASSERT_TRUE(write_endorser_config(files, {"127.0.0.1:1", {}, {}}));
  for (const auto& [file, program] : {std::pair{"link", "link"},
                                      {"agent", "agent"},
                                      {"ground", "ground"},
                                      {"admin", "control"},
                                      {"operator", "control"},
                                      {"endorser", "endorser"}}) {
    auto config = Config::load(files.config(file));
    ASSERT_TRUE(config) << config.error().message;
    const Status read = check(program, *config);
    EXPECT_TRUE(read) << read.error().message;
  }
  std::filesystem::remove_all(folder);
}

TEST(WrittenConfigs, AreReadByTheirPrograms) {
  expect_read({});
  launcher::Options manual;
  manual.manual = manual.watch = manual.shim = manual.endorser_within = true;
  manual.batch_timeout_ns = 2 * ns_per_s;
  manual.batch_count = 10;
  manual.max_age_ns = 5 * ns_per_s;
  manual.pads = {{.id = 1}};
  manual.pose = "pads";
  manual.drones = 2;
  expect_read(manual);
}

}  // namespace
}  // namespace ledgerline::configuration
