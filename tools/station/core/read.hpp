#pragma once
#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

#include "common/base/result.hpp"
#include "common/base/text.hpp"

namespace ledgerline::station {

using nlohmann::json;

inline std::string text_of(const json& value) { return printable(value.get_ref<const std::string&>()); }
inline std::string text_at(const json& object, const char* key) { return text_of(object.at(key)); }

/// `read` may throw nlohmann's exceptions: the answer is then no `what`.
template <typename T, typename Read>
Result<T> read_answer(std::string_view body, std::string_view what, const Read& read) {
  try {
    return Result<T>(read(json::parse(body)));
  } catch (const json::exception& wrong) {
    return Error{
        fmt::format("the station's answer is not {} as version 1 of its API has them ({})", what, wrong.what())};
  }
}

}  // namespace ledgerline::station
