#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <set>
#include <string>

#include "ground/service/shell/page_files.hpp"

// Built twice: with the page as this build has it, and with the page that lacks its libraries.
namespace ledgerline::ground::service {
namespace {

using testing::Contains;
using testing::HasSubstr;
using testing::StartsWith;

constexpr const char* gzip_magic = "\x1f\x8b";

std::set<std::string> names() {
  std::set<std::string> all;
  for (std::size_t i = 0; i < page_file_count; ++i) all.insert(page_files[i].name);
  return all;
}
std::string bytes_of(const std::string& name) {
  for (std::size_t i = 0; i < page_file_count; ++i) {
    if (name == page_files[i].name) return {reinterpret_cast<const char*>(page_files[i].bytes), page_files[i].size};
  }
  return {};
}

TEST(Page, HasItsOwnFilesByteForByte) {
  EXPECT_THAT(bytes_of("index.html"), StartsWith("<!doctype html>"));
  EXPECT_THAT(bytes_of("index.html"), HasSubstr("</html>"));
  EXPECT_THAT(names(), Contains("main.js"));
  EXPECT_THAT(names(), Contains("draft.js"));
  EXPECT_THAT(names(), Contains("style.css"));
}

TEST(Page, EveryLibraryIsCompressedAndNothingElse) {
  for (std::size_t i = 0; i < page_file_count; ++i) {
    const PageFile& file = page_files[i];
    EXPECT_EQ(file.gzip, std::string(file.name).rfind("lib/", 0) == 0) << file.name;
    EXPECT_EQ(file.gzip, bytes_of(file.name).rfind(gzip_magic, 0) == 0) << file.name;
  }
}

TEST(Page, WithALibraryItHasThemAllAndTheirLicences) {
  EXPECT_THAT(names(), Contains("lib/built.js")) << "the page asks it what is built in";
  const std::set<std::string> libraries{"lib/three.module.js",   "lib/three.core.js", "lib/OrbitControls.js",
                                        "lib/three-LICENSE.txt", "lib/uPlot.esm.js",  "lib/uPlot.min.css",
                                        "lib/uPlot-LICENSE.txt"};
  const std::set<std::string> all = names();
  for (const std::string& library : libraries) EXPECT_EQ(all.count(library), LEDGERLINE_PAGE_LIBRARIES) << library;
}

TEST(Page, NamesTheModulesThatItNeedsSoThatTheyAreAskedForAtOnce) {
  const std::string page = bytes_of("index.html");
  const auto at = [&](const std::string& module) {
    return page.find("<link rel=\"modulepreload\" href=\"/page/" + module + "\">");
  };
  // One that main.js imports, one that is imported by such a one, one that is made by the build.
  for (const char* module : {"main.js", "connection.js", "operators/rules.js", "missions/words.js", "lib/built.js"}) {
    EXPECT_NE(at(module), std::string::npos) << module;
    EXPECT_GT(at(module), page.find("type=\"importmap\"")) << "browsers want the map first";
  }
  for (const char* later : {"look/scene.js", "look/histogram.js"}) EXPECT_EQ(at(later), std::string::npos) << later;
}

TEST(Page, NamesItsImportMapForThePolicy) {
  EXPECT_THAT(std::string(page_scripts), testing::MatchesRegex("'sha256-[A-Za-z0-9+/]+='"));
}

}  // namespace
}  // namespace ledgerline::ground::service
