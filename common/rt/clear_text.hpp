#pragma once
#include <string>
#include <string_view>

namespace ledgerline {

/// Text that a stranger had a part in, fit for a message: one line of UTF-8, at most `most` bytes; what is neither
/// printable nor UTF-8 is shown as "?".
std::string clear_text(std::string_view text, std::size_t most = 1'000);

}  // namespace ledgerline
