#pragma once
#include <fstream>
#include <sstream>
#include <string>

namespace ledgerline::deployment {

inline std::string text_of_page(const std::string& name) {
  std::ifstream file(LEDGERLINE_SOURCE "/docs/" + name);
  std::stringstream text;
  text << file.rdbuf();
  return text.str();
}

inline std::string fabric_example() { return text_of_page("examples/deployment-fabric.toml"); }
inline std::string one_machine_example() { return text_of_page("examples/deployment-one-machine.toml"); }

/// The first block of TOML in docs/fly.md.
inline std::string real_drones_example() {
  const std::string page = text_of_page("fly.md"), fence = "```toml\n";
  const std::size_t begin = page.find(fence) + fence.size();
  return page.substr(begin, page.find("```", begin) - begin);
}

}  // namespace ledgerline::deployment
