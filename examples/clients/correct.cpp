// Ask a running `gpcorrect serve` what to command: C++17 and zenoh-c 1.x (https://github.com/eclipse-zenoh/zenoh-c).
//
//     g++ -std=c++17 correct.cpp -lzenohc -o correct
//     ./correct tcp/127.0.0.1:7449 arm1 0.1 0.02 -0.11 1 0 0 0
//
// Prints the answer, JSON as docs/service.md describes it, and ends with 0; with 1 after a refusal, and when nobody answers.
#include <iostream>
#include <string>

#include "zenoh.h"

int main(int count, char** words) {
    if (count != 10) return std::cerr << "usage: correct ENDPOINT ARM X Y Z QW QX QY QZ\n", 2;
    std::string pose = words[3];
    for (int i = 4; i < count; ++i) pose += std::string(", ") + words[i];
    const std::string endpoints = std::string("[\"") + words[1] + "\"]", question = "{\"pose\": [" + pose + "]}";
    const std::string key = std::string("gpcorrect/") + words[2] + "/correct";

    z_owned_config_t config;
    z_config_default(&config);
    zc_config_insert_json5(z_loan_mut(config), "mode", "\"client\"");
    zc_config_insert_json5(z_loan_mut(config), "connect/endpoints", endpoints.c_str());
    z_owned_session_t session;  // a planner keeps it, and asks many times
    if (z_open(&session, z_move(config), nullptr) < 0) return std::cerr << "no server at " << words[1] << "\n", 1;

    z_get_options_t options;
    z_get_options_default(&options);
    z_owned_bytes_t payload;
    z_bytes_copy_from_str(&payload, question.c_str());
    options.payload = z_move(payload);
    options.timeout_ms = 500;
    z_view_keyexpr_t asked;
    z_view_keyexpr_from_str(&asked, key.c_str());
    z_owned_closure_reply_t sender;
    z_owned_fifo_handler_reply_t replies;
    z_fifo_channel_reply_new(&sender, &replies, 1);
    z_get(z_loan(session), z_loan(asked), "", z_move(sender), &options);

    int status = -1;
    z_owned_reply_t reply;
    while (z_recv(z_loan(replies), &reply) == Z_OK) {
        const bool good = z_reply_is_ok(z_loan(reply));
        z_owned_string_t text;
        z_bytes_to_string(good ? z_sample_payload(z_reply_ok(z_loan(reply)))
                               : z_reply_err_payload(z_reply_err(z_loan(reply))), &text);
        (good ? std::cout : std::cerr).write(z_string_data(z_loan(text)), z_string_len(z_loan(text))) << std::endl;
        status = good ? 0 : 1;
        z_drop(z_move(text));
        z_drop(z_move(reply));
    }
    if (status < 0) std::cerr << "nobody answers " << key << "\n";
    z_drop(z_move(replies));
    z_drop(z_move(session));
    return status == 0 ? 0 : 1;
}
