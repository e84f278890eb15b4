#include "common/page/html.hpp"

#include <ctime>
#include <nlohmann/json.hpp>

namespace ledgerline::page {

using nlohmann::json;

std::string for_script(const json& data) {
  std::string text = data.dump(-1, ' ', false, json::error_handler_t::replace);
  for (std::size_t at = 0; (at = text.find('<', at)) != std::string::npos; at += 6) text.replace(at, 1, "\\u003c");
  return text;
}

std::string filled(const std::string& page, const std::string& mark, const std::string& content) {
  const auto at = page.find(mark);
  return page.substr(0, at) + content + page.substr(at + mark.size());
}

std::string local_date() {
  const std::time_t now = std::time(nullptr);
  std::tm local{};
  localtime_r(&now, &local);
  char text[64];
  std::strftime(text, sizeof text, "%Y-%m-%d %H:%M", &local);
  return text;
}

}  // namespace ledgerline::page
