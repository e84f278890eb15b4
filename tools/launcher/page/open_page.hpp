#pragma once
#include <string>

#include "common/base/result.hpp"

namespace ledgerline::fly {

/// Opens `url` in the local user's browser (xdg-open), which is a process of its own. The url holds a token, so the
/// browser is given `file`, made for this owner alone, which leads there: a command line can be read by everybody.
Status open_in_browser(const std::string& url, const std::string& file);

}  // namespace ledgerline::fly
