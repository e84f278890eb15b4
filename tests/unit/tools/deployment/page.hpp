#pragma once
#include <fstream>
#include <sstream>
#include <string>

namespace ledgerline::deployment {

/// A block of TOML in a page, from 0 on.
inline std::string example_of_the_page(int number, const std::string& name = "docs/deployment.md") {
  std::ifstream file(LEDGERLINE_SOURCE "/" + name);
  std::stringstream text;
  text << file.rdbuf();
  const std::string page = text.str(), fence = "```toml\n";
  std::size_t begin = 0;
  for (int k = 0; k <= number; ++k) begin = page.find(fence, begin) + fence.size();
  return page.substr(begin, page.find("```", begin) - begin);
}

}  // namespace ledgerline::deployment
