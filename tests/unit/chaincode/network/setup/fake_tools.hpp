#pragma once
#include <gmock/gmock.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <string>
#include <vector>

#include "chaincode/network/options.hpp"
#include "common/base/file.hpp"

namespace ledgerline::network {

/// A folder with stand-ins for Fabric's programs, which note how they are called and succeed; it goes with the test.
class FakeTools {
 public:
  FakeTools() {
    EXPECT_NE(::mkdtemp(folder_.data()), nullptr);
    for (const char* program : {"orderer", "peer", "configtxgen", "osnadmin"}) {
      script(program, "echo \"${0##*/} $*\" >>" + folder_ + "/calls");
    }
    for (const char* file : {"core.yaml", "orderer.yaml"}) {
      EXPECT_TRUE(write_file(folder_ + "/tools/config/" + file, "", 0644).ok());
    }
  }
  ~FakeTools() { std::filesystem::remove_all(folder_); }
  FakeTools(const FakeTools&) = delete;
  FakeTools& operator=(const FakeTools&) = delete;

  void script(const std::string& program, const std::string& text) const {
    EXPECT_TRUE(write_file(folder_ + "/tools/" + program, "#!/bin/sh\n" + text + "\n", 0755).ok());
  }
  /// How the programs were called since the last call of this, one line each.
  std::vector<std::string> calls() const {
    std::vector<std::string> lines;
    const auto text = read_file(folder_ + "/calls");
    for (std::size_t begin = 0; text && begin < text->size();) {
      const std::size_t end = text->find('\n', begin);
      lines.push_back(text->substr(begin, end - begin));
      begin = end + 1;
    }
    std::filesystem::remove(folder_ + "/calls");
    return lines;
  }
  Options options() const {
    Options options;
    options.dir = folder_ + "/net";
    options.tools = folder_ + "/tools";
    return options;
  }

 private:
  std::string folder_ = testing::TempDir() + "ledgerline_tools_XXXXXX";
};

}  // namespace ledgerline::network
