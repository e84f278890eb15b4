#pragma once
#include <string>
#include <string_view>

namespace ledgerline {

/// Makes text from outside printable, for logs, refusals and terminals: one line of valid UTF-8, at most `max_size`
/// bytes; whatever cannot be printed becomes "?". (Nothing to do with encryption.)
std::string printable(std::string_view text, std::size_t max_size = 1'000);

/// As it stands in an element or an attribute of XML; a control but a newline becomes a space.
std::string xml_text(std::string_view text);

}  // namespace ledgerline
