"""Compile a chat template before its model is used: it is a program out of the model's file.

Jinja's sandbox keeps it from the machine's files. A file of unknown hash is opened in a process of
its own first, within a time limit, and llama-cpp-python compiles its templates there.
"""

TEMPLATE = "tokenizer.chat_template"  # key of a GGUF's metadata


def try_template(name: str, text: str) -> str:
    """Compile a model's template; return why it cannot be used, or ""."""
    from llama_cpp.llama_chat_format import Jinja2ChatFormatter

    try:
        Jinja2ChatFormatter(template=text, bos_token="", eos_token="")
    except Exception as error:  # noqa: BLE001 - jinja2 raises errors of many classes
        return f"its chat template cannot be used: {str(error)[:200]}"
    return ""
