#include "common/rt/file.hpp"

#include <fstream>
#include <sstream>

namespace ledgerline {

Result<std::string> read_file(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  std::stringstream text;
  if (!in || !(text << in.rdbuf())) return Error{"cannot read " + path};
  return text.str();
}

}  // namespace ledgerline
