#pragma once
#include <string>
#include <vector>

#include "common/config/config.hpp"

/// The reference of every key of every program, docs/configuration.md, made from the readers: each reads a describing
/// Config (common/config), so a key cannot be in a program and not on the page.
namespace ledgerline::configuration {

/// The keys of one file, or of tables that several files have.
struct Part {
  std::string name;                  ///< "agent", "the ledger"
  std::string words;                 ///< what the file is and who reads it; Markdown
  std::vector<std::string> shared;   ///< names of the parts whose tables it has, too
  std::vector<KeyDescription> keys;  ///< its own, in the reader's order
};

/// All of them; what several files share comes last.
std::vector<Part> parts();

/// Has the readers of a program ("agent") read its file: the keys, as at its start. What else it loads, such as keys
/// and certificates, is not checked.
Status check(const std::string& part, Config& config);

/// One part, or the whole page, as Markdown.
std::string show(const Part& part);
std::string page();

}  // namespace ledgerline::configuration
