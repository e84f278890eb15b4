#pragma once
#include <string>
#include <vector>

#include "common/base/result.hpp"

namespace ledgerline::init {

struct NewFile {
  std::string path, content;
  int mode = 0644;
};

/// An error names all that are there.
Status check_new(const std::vector<std::string>& paths);

/// All of them, or none: a file that is there is an error, unless it has this content already.
Status write_new(const std::vector<NewFile>& files);

}  // namespace ledgerline::init
