#pragma once
#include <openssl/ssl.h>

/// How all of Ledgerline speaks TLS, listeners and clients alike; the page: SECURITY.md, "TLS".
///
/// gRPC's listeners and clients (common/fabric/tls, common/fabric/client) cannot be configured: version 1.51 has no
/// call for versions or ciphers. Its defaults are what stands here: tests/unit/common/crypto/tls_policy_test.cpp
/// connects to each listener, and each client to servers, with one version and cipher at a time, to see that they still
/// are.
///
/// Client certificates: a listener that is given authorities for its clients ends each connection without a
/// certificate of theirs, and one that is given none asks for none. Nowhere is a certificate asked for and not needed.
namespace ledgerline::crypto {

/// 1.2 is the least that RFC 9325 permits, and 1.3 comes by itself where both sides have it.
inline constexpr int tls_min_version = TLS1_2_VERSION;
/// Of TLS 1.2, in OpenSSL's words: forward secrecy and authenticated encryption, as HTTP/2 demands (RFC 9113, appendix
/// A). All ciphers of 1.3 are of this kind.
inline constexpr const char* tls12_ciphers = "ECDHE+AESGCM";

inline void apply_tls_policy(SSL_CTX* context) {
  SSL_CTX_set_min_proto_version(context, tls_min_version);
  SSL_CTX_set_cipher_list(context, tls12_ciphers);
  SSL_CTX_set_options(context, SSL_OP_NO_COMPRESSION | SSL_OP_NO_RENEGOTIATION | SSL_OP_CIPHER_SERVER_PREFERENCE |
                                   SSL_OP_CLEANSE_PLAINTEXT);  // a pass phrase comes by it
  // Else OpenSSL would ask for the pass phrase of a locked key at the terminal, and wait.
  SSL_CTX_set_default_passwd_cb(context, [](char*, int, int, void*) { return -1; });
  // A session that is taken up again would outlive a change of certificates; handshakes here are few.
  SSL_CTX_set_options(context, SSL_OP_NO_TICKET);
  SSL_CTX_set_session_cache_mode(context, SSL_SESS_CACHE_OFF);
}

}  // namespace ledgerline::crypto
