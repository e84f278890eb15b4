#pragma once

namespace ledgerline {

/// Scripts for these shells, which ask `ledgerline __complete` for each word.
extern const char* const bash_completion;
extern const char* const zsh_completion;

}  // namespace ledgerline
