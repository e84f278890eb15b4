#pragma once
#include <nlohmann/json_fwd.hpp>
#include <string>

/// What the pages share: they open without a network, so everything is inside them.
namespace ledgerline::page {

/// As text of a script element, in which no string can look like the element's end.
std::string for_script(const nlohmann::json& data);
/// `page` with the first `mark` replaced.
std::string filled(const std::string& page, const std::string& mark, const std::string& content);
/// "2026-11-22 01:30"
std::string local_date();

}  // namespace ledgerline::page
